// Charts that follow the playback: a line at the time shown, numbers under the pointer, a click to go there.
import { askTime, onTime, pointAt } from "linktwin-page";

const make = (name) => document.createElementNS("http://www.w3.org/2000/svg", name);

function geometry(svg) {
  const [left, right, top, bottom] = svg.dataset.box.split(",").map(Number);
  const [x0, x1, y0, y1] = svg.dataset.range.split(",").map(Number);
  const { width, height } = svg.viewBox.baseVal;
  return { left, right: width - right, top, bottom: height - bottom, x0, x1, y0, y1, width, height };
}

export default {
  template: `<div class="timeline" ref="root"><slot></slot></div>`,
  mounted() {
    this.told = [null, 0];
    this.now = new Map();
    this.places = new Map();
    this.known = new Set();
    this.inView = new Set();
    this.eye = new IntersectionObserver((seen) => {
      for (const { target, isIntersecting } of seen) isIntersecting ? this.inView.add(target) : this.inView.delete(target);
      this.follow();
    });
    this.sized = new ResizeObserver(() => { this.places.clear(); this.follow(); });
    this.sized.observe(this.$el);
    this.grown = new MutationObserver(() => this.watch());
    this.grown.observe(this.$el, { childList: true, subtree: true });
    this.watch();
    this.end = onTime(({ motion, time_s }) => this.follow(motion, time_s));
    this.$el.addEventListener("pointermove", (event) => this.read(event));
    this.$el.addEventListener("pointerleave", () => this.forget(), true);
    this.$el.addEventListener("click", (event) => this.go(event));
    this.$el.addEventListener("pointerover", (event) => this.part(event));
    this.$el.addEventListener("focusin", (event) => this.part(event));
  },
  unmounted() { this.end?.(); this.eye?.disconnect(); this.sized?.disconnect(); this.grown?.disconnect(); },
  methods: {
    linked(svg) { return svg.closest("[data-run]")?.dataset; },
    // The line stands over the chart and not in it: moving it repaints nothing.
    follow(motion, time_s) {
      if (motion !== undefined) this.told = [motion, time_s];
      for (const svg of this.inView) {
        const link = this.linked(svg);
        if (!link) continue;
        const line = this.line(svg), on = link.run === this.told[0], place = this.places.get(svg) ?? this.measure(svg);
        const x = this.told[1] - Number(link.offset || 0), at = place.left + (x - place.x0) / (place.x1 - place.x0) * place.width;
        const seen = on && at >= place.left - 0.5 && at <= place.left + place.width + 0.5;
        if (line.hidden === seen) line.hidden = !seen;
        if (seen) line.style.transform = `translateX(${at.toFixed(1)}px)`;
      }
    },
    line(svg) {
      let line = this.now.get(svg);
      if (!line?.isConnected) {
        line = Object.assign(document.createElement("i"), { className: "now", hidden: true });
        svg.parentElement.append(line);
        this.now.set(svg, line);
      }
      return line;
    },
    measure(svg) {
      const g = geometry(svg), box = svg.getBoundingClientRect(), frame = svg.parentElement.getBoundingClientRect(), scale = box.width / g.width;
      const place = { left: box.left - frame.left + scale * g.left, width: scale * (g.right - g.left), x0: g.x0, x1: g.x1 };
      Object.assign(this.line(svg).style, { top: `${box.top - frame.top + scale * g.top}px`, height: `${scale * (g.bottom - g.top)}px` });
      this.places.set(svg, place);
      return place;
    },
    watch() {
      for (const svg of this.$el.querySelectorAll("svg.chart")) if (!this.known.has(svg)) { this.known.add(svg); this.eye.observe(svg); }
    },
    under(event) {
      const svg = event.target.closest?.("svg.chart");
      if (!svg) return null;
      const g = geometry(svg), box = svg.getBoundingClientRect();
      const px = (event.clientX - box.left) / box.width * g.width, py = (event.clientY - box.top) / box.height * g.height;
      if (px < g.left || px > g.right || py < g.top || py > g.bottom) return null;
      const y = g.y0 + (g.bottom - py) / (g.bottom - g.top) * (g.y1 - g.y0);
      return { svg, g, px, py, x: g.x0 + (px - g.left) / (g.right - g.left) * (g.x1 - g.x0), y: svg.dataset.log ? 10 ** y : y };
    },
    read(event) {
      const at = this.under(event);
      if (this.cross && (!at || this.cross.svg !== at.svg)) this.forget();
      if (!at) return;
      if (!this.cross) {
        const line = make("path"), text = make("text");
        line.setAttribute("class", "cursor"); text.setAttribute("class", "cursor");
        at.svg.append(line, text);
        this.cross = { svg: at.svg, line, text };
      }
      const { g, px, py } = at, right = px > g.width / 2;
      this.cross.line.setAttribute("d", `M${px} ${g.top}V${g.bottom}M${g.left} ${py}H${g.right}`);
      this.cross.text.textContent = `${at.x.toPrecision(4)}, ${at.y.toPrecision(4)}`;
      this.cross.text.setAttribute("x", px + (right ? -6 : 6));
      this.cross.text.setAttribute("y", g.top + 10);
      this.cross.text.setAttribute("text-anchor", right ? "end" : "start");
    },
    forget() { this.cross?.line.remove(); this.cross?.text.remove(); this.cross = null; },
    go(event) {
      const at = this.under(event), link = at && this.linked(at.svg);
      if (link?.run) askTime(link.run, at.x + Number(link.offset || 0));
    },
    part(event) {
      const named = event.target.closest?.("[data-part]");
      if (named) pointAt(named.dataset.part);
    },
  },
};
