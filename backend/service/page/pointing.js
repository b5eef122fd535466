// Pointing at things in a picture: each point of a list is placed by a click, or with the arrow keys and Enter.
const LENS = 5; // times larger under the pointer
const FAR = 14; // screen pixels within which a click takes hold of a point that is there already
const HINTS = {
  marks: "Four or more points whose places on the bed you know, spread wide. Type where they are, then click on each.",
  tags: "The kit's printed tags on the bed (linktwin kit) are found in the picture by themselves: type which lies where, its centre. Four or more, alone or with marks.",
  stick: "In place of marks, where one length is all that is known: click on its two ends and type how long it is. The origin of the drawing's coordinates is the first end unless you place it; type its pixels where it lies outside the picture.",
  dots: "Only needed where the tracker asks which dot is which, and for coloured areas and surfaces. Click on the centre of each.",
};

export default {
  template: `
    <div class="pointing">
      <div class="pointing-side">
        <div class="pointing-tabs" role="tablist" aria-label="What to point at">
          <button v-for="kind in kinds" :key="kind.id" type="button" role="tab" :aria-selected="mode === kind.id" @click="turn(kind.id)">
            {{ kind.name }} <span>{{ kind.points.filter(kind.id === 'tags' ? typed : placed).length }}/{{ kind.points.length }}</span></button>
        </div>
        <p class="note">{{ hint }}</p>
        <ol class="pointing-list">
          <li v-for="point in list" :key="point.id" :class="{ active: active === point.id, placed: done(point) }">
            <button type="button" class="pointing-name" @click="choose(point.id)" :aria-pressed="active === point.id">
              <i></i>{{ point.id }}<span>{{ mode === 'tags' ? (done(point) ? '' : 'type x and y') : placed(point) ? point.x_px.toFixed(1) + ', ' + point.y_px.toFixed(1) + ' px' : active === point.id ? 'click in the picture' : 'not placed' }}</span></button>
            <template v-if="mode === 'marks' || mode === 'tags'">
              <label>x <input type="number" step="any" v-model.number="point.x_mm" @input="tell" :aria-label="'x of ' + point.id + ' in mm'"> mm</label>
              <label>y <input type="number" step="any" v-model.number="point.y_mm" @input="tell" :aria-label="'y of ' + point.id + ' in mm'"> mm</label>
            </template>
            <template v-if="mode === 'stick'">
              <label>x <input type="number" step="any" v-model.number="point.x_px" @input="tell(); paint()" :aria-label="'x of ' + point.id + ' in pixels'"> px</label>
              <label>y <input type="number" step="any" v-model.number="point.y_px" @input="tell(); paint()" :aria-label="'y of ' + point.id + ' in pixels'"> px</label>
            </template>
            <label v-if="mode === 'dots' && tagged">tag <input type="text" placeholder="3" v-model.trim="point.tag" @input="tell" :aria-label="'tag on ' + point.id"></label>
            <button v-if="mode === 'tags'" type="button" class="quiet" @click="leave(point)" :aria-label="'Leave out ' + point.id">×</button>
            <button v-else-if="placed(point)" type="button" class="quiet" @click="drop(point)" :aria-label="'Take ' + point.id + ' off'">×</button>
          </li>
        </ol>
        <label v-if="mode === 'stick'" class="field"><span>the known length [mm]</span>
          <input class="in" type="number" min="0" step="any" v-model.number="own.length_mm" @input="tell"></label>
        <button v-if="mode === 'marks'" type="button" class="act small" @click="more">Add a mark</button>
        <button v-if="mode === 'tags'" type="button" class="act small" @click="another">Add a tag</button>
      </div>
      <div class="pointing-view" ref="view" tabindex="0" role="application" aria-label="First frame of the clip. Arrow keys move the cross, or the chosen point once it is placed; Shift with them by ten pixels, Enter places the point."
           @keydown="keyed">
        <canvas ref="canvas" @pointerdown="press" @pointermove="move" @pointerup="release" @pointerleave="away" @wheel.prevent="wheel"></canvas>
        <p v-if="trouble" class="pointing-trouble" role="alert">{{ trouble }}</p>
        <div class="pointing-zoom"><button type="button" @click="zoom(1.5)" aria-label="Larger">+</button><button type="button" @click="zoom(1 / 1.5)" aria-label="Smaller">−</button><button type="button" @click="whole">whole</button></div>
      </div>
    </div>`,
  props: { picture: String, points: Object, tagged: Boolean },
  emits: ["points"],
  data() {
    return { mode: "marks", active: null, trouble: "", own: JSON.parse(JSON.stringify({ length_mm: null, ...this.points })) };
  },
  computed: {
    kinds() { return [{ id: "marks", name: "Marks", points: this.own.marks }, { id: "tags", name: "Tags", points: this.own.tags }, { id: "stick", name: "A length", points: this.own.stick }, { id: "dots", name: "Dots", points: this.own.dots }]; },
    list() { return this.own[this.mode]; },
    hint() {
      return HINTS[this.mode];
    },
  },
  mounted() {
    this.load();
    this.active = this.list.find((p) => !this.placed(p))?.id ?? null;
    this.seen = new ResizeObserver(() => this.whole());
    this.seen.observe(this.$refs.view);
  },
  unmounted() { this.seen?.disconnect(); },
  watch: { picture() { this.load(); } },
  methods: {
    load() {
      const image = this.image = new Image(), address = this.picture;
      image.onload = () => { if (this.image !== image) return; this.trouble = ""; this.whole(); this.$el.dataset.ready = "yes"; };
      image.onerror = async () => {
        const answer = await fetch(address).catch(() => null), said = answer ? await answer.text() : "";
        if (this.image === image) this.trouble = answer ? `This frame of the clip cannot be shown. ${said}` : "The frame cannot be fetched; reload the page.";
      };
      image.src = address;
    },
    done(point) { return this.mode === "tags" ? this.typed(point) : this.placed(point); },
    typed: (point) => Number.isFinite(point.x_mm) && Number.isFinite(point.y_mm),
    placed: (point) => Number.isFinite(point.x_px) && Number.isFinite(point.y_px),
    turn(kind) { this.mode = kind; this.active = this.list.find((p) => !this.placed(p))?.id ?? null; this.paint(); },
    choose(id) { this.active = id; this.paint(); this.$refs.view.focus(); },
    more() {
      let n = this.own.marks.length;
      const name = (k) => k < 26 ? String.fromCharCode(65 + k) : `M${k}`;
      while (this.own.marks.some((m) => m.id === name(n))) n++;
      this.own.marks.push({ id: name(n), x_mm: 0, y_mm: 0, x_px: null, y_px: null });
      this.active = name(n);
      this.tell();
    },
    another() {
      const number = 1 + Math.max(-1, ...this.own.tags.map((t) => t.number));
      this.own.tags.push({ id: `tag ${number}`, number, x_mm: null, y_mm: null });
      this.tell();
    },
    leave(tag) { this.own.tags = this.own.tags.filter((t) => t !== tag); this.tell(); },
    drop(point) { point.x_px = point.y_px = null; this.active = point.id; this.tell(); this.paint(); },
    tell() { this.$emit("points", this.own); },
    whole() {
      const view = this.$refs.view;
      if (!view || !this.image.naturalWidth) return;
      const { clientWidth: width, clientHeight: height } = view;
      this.scale = Math.min(width / this.image.naturalWidth, height / this.image.naturalHeight);
      this.least = this.scale;
      this.left = (width - this.image.naturalWidth * this.scale) / 2;
      this.top = (height - this.image.naturalHeight * this.scale) / 2;
      this.cross ??= [this.image.naturalWidth / 2, this.image.naturalHeight / 2];
      this.paint();
    },
    zoom(factor, about) {
      const [x, y] = about ?? [this.$refs.view.clientWidth / 2, this.$refs.view.clientHeight / 2];
      const next = Math.min(16, Math.max(this.least * 0.8, this.scale * factor)), by = next / this.scale;
      this.left = x - (x - this.left) * by;
      this.top = y - (y - this.top) * by;
      this.scale = next;
      this.paint();
    },
    wheel(event) { this.zoom(event.deltaY < 0 ? 1.2 : 1 / 1.2, [event.offsetX, event.offsetY]); },
    // (0, 0) is the centre of the corner pixel
    pixel(event) { return [(event.offsetX - this.left) / this.scale - 0.5, (event.offsetY - this.top) / this.scale - 0.5]; },
    screen([x, y]) { return [(x + 0.5) * this.scale + this.left, (y + 0.5) * this.scale + this.top]; },
    press(event) {
      this.$refs.canvas.setPointerCapture(event.pointerId);
      const at = [event.offsetX, event.offsetY];
      const near = this.list.find((p) => this.placed(p) && Math.hypot(this.screen([p.x_px, p.y_px])[0] - at[0], this.screen([p.x_px, p.y_px])[1] - at[1]) < FAR);
      this.held = { at, left: this.left, top: this.top, near: near ?? null, far: false };
      if (near) this.active = near.id;
    },
    move(event) {
      this.cross = this.pixel(event);
      this.hover = [event.offsetX, event.offsetY];
      if (this.held) {
        const [dx, dy] = [event.offsetX - this.held.at[0], event.offsetY - this.held.at[1]];
        if (Math.hypot(dx, dy) > 4) this.held.far = true;
        if (this.held.far && this.held.near) [this.held.near.x_px, this.held.near.y_px] = this.cross;
        else if (this.held.far) { this.left = this.held.left + dx; this.top = this.held.top + dy; }
      }
      this.paint();
    },
    release(event) {
      const held = this.held;
      this.held = null;
      if (!held) return;
      if (held.near) { if (held.far) this.tell(); return this.paint(); }
      if (!held.far) this.place(this.pixel(event));
    },
    away() { this.hover = null; this.paint(); },
    place([x, y]) {
      const point = this.list.find((p) => p.id === this.active);
      if (!point || this.mode === "tags" || !this.put(point, [x, y])) return;
      this.active = this.list.find((p) => !this.placed(p))?.id ?? this.active;
      this.paint();
    },
    put(point, [x, y]) {
      if (x < -0.5 || y < -0.5 || x > this.image.naturalWidth - 0.5 || y > this.image.naturalHeight - 0.5) return false;
      [point.x_px, point.y_px] = [Math.round(10 * x) / 10, Math.round(10 * y) / 10];
      this.tell();
      return true;
    },
    keyed(event) {
      const step = event.shiftKey ? 10 : 1, moves = { ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, -step], ArrowDown: [0, step] };
      if (moves[event.key]) {
        const point = this.list.find((p) => p.id === this.active && this.mode !== "tags" && this.placed(p));
        const [x, y] = point ? [point.x_px, point.y_px] : this.cross.map(Math.round);
        this.cross = [x + moves[event.key][0], y + moves[event.key][1]];
        this.hover = this.screen(this.cross);
        if (point) this.put(point, this.cross);
      } else if (event.key === "Enter" || event.key === " ") this.place(this.cross);
      else if (event.key === "+") this.zoom(1.5, this.screen(this.cross));
      else if (event.key === "-") this.zoom(1 / 1.5, this.screen(this.cross));
      else return;
      event.preventDefault();
      this.paint();
    },
    paint() {
      const canvas = this.$refs.canvas, view = this.$refs.view, ratio = window.devicePixelRatio || 1;
      if (!canvas || !this.image?.naturalWidth) return;
      const { clientWidth: width, clientHeight: height } = view;
      canvas.width = width * ratio; canvas.height = height * ratio;
      const pen = canvas.getContext("2d"), ink = (name) => getComputedStyle(view).getPropertyValue(`--${name}`);
      pen.scale(ratio, ratio);
      pen.imageSmoothingEnabled = this.scale < 3;
      pen.drawImage(this.image, this.left, this.top, this.image.naturalWidth * this.scale, this.image.naturalHeight * this.scale);
      const target = (at, colour, name) => {
        const [x, y] = this.screen(at);
        for (const [style, wide] of [["#fff", 4], [colour, 2]]) {
          pen.strokeStyle = style; pen.lineWidth = wide;
          pen.beginPath(); pen.arc(x, y, 8, 0, 7); pen.moveTo(x - 13, y); pen.lineTo(x - 3, y); pen.moveTo(x + 3, y); pen.lineTo(x + 13, y);
          pen.moveTo(x, y - 13); pen.lineTo(x, y - 3); pen.moveTo(x, y + 3); pen.lineTo(x, y + 13); pen.stroke();
        }
        pen.font = "600 13px system-ui, sans-serif"; pen.lineWidth = 3.5; pen.strokeStyle = "#fff"; pen.strokeText(name, x + 12, y - 10);
        pen.fillStyle = colour; pen.fillText(name, x + 12, y - 10);
      };
      for (const kind of this.kinds) for (const p of kind.points) {
        if (this.placed(p)) target([p.x_px, p.y_px], p.id === this.active && kind.id === this.mode ? "#c2571a" : kind.id === "dots" ? "#1c7a3d" : "#0b6bb8", p.id);
      }
      if (this.hover && this.cross && this.active) this.lens(pen, width, ink("rule"));
    },
    lens(pen, width, rule) {
      const size = 130, left = this.hover[0] > width / 2 ? 10 : width - size - 10, top = 10;
      const scale = Math.max(LENS, this.scale * 2.5), [x, y] = this.cross;
      pen.save();
      pen.beginPath(); pen.roundRect(left, top, size, size, 8); pen.fillStyle = "#000"; pen.fill(); pen.clip();
      pen.imageSmoothingEnabled = false;
      pen.drawImage(this.image, left + size / 2 - (x + 0.5) * scale, top + size / 2 - (y + 0.5) * scale, this.image.naturalWidth * scale, this.image.naturalHeight * scale);
      for (const [style, wide] of [["#fff", 3], ["#c2571a", 1]]) {
        pen.strokeStyle = style; pen.lineWidth = wide;
        pen.beginPath(); pen.moveTo(left, top + size / 2); pen.lineTo(left + size, top + size / 2); pen.moveTo(left + size / 2, top); pen.lineTo(left + size / 2, top + size); pen.stroke();
      }
      pen.restore();
      pen.strokeStyle = rule; pen.lineWidth = 1.5; pen.beginPath(); pen.roundRect(left, top, size, size, 8); pen.stroke();
    },
  },
};
