import { askTime, onAsked, onPart, onScheme, onTime, pointAt, Stage, tellTime } from "linktwin-page";

const PACES = [1, 0.5, 0.25, 0.1, 0.05];
const WATCHED_S = 4; // a motion shorter than that is slowed down
const LETTER = 7.5; // pixels of a name
const MOST_FAULTS = 4; // told of meshes that are not shown
const KEPT = 1200; // stamps of drawn frames, and what each cost, to see how smoothly it plays

export default {
  template: `
    <div class="stage" role="group" :aria-label="title">
      <div class="stage-view" ref="view" tabindex="0" :aria-label="title + ', in three dimensions. Arrow keys turn it, plus and minus zoom, F fits it.'"
           role="img" @keydown="turned">
        <canvas ref="canvas" @pointerdown="down" @pointerup="picked" aria-hidden="true"></canvas>
        <div class="stage-names" ref="names" aria-hidden="true"></div>
        <div class="stage-scale" ref="scale" aria-hidden="true"><i></i><span></span></div>
        <div class="stage-cameras" role="group" aria-label="View">
          <button v-for="view in views" :key="view.id" type="button" :title="view.title" @click="look(view.id)">{{ view.name }}</button>
        </div>
      </div>
      <div v-if="trouble || faults.length" class="stage-trouble" role="status">
        {{ trouble }}<ul v-if="faults.length"><li v-for="fault in faults" :key="fault">{{ fault }}</li></ul>
      </div>
      <div v-if="motions.length" class="stage-bar">
        <button type="button" class="stage-play" @click="toggle" :aria-label="playing ? 'Pause' : 'Play'" :aria-pressed="playing">
          <svg viewBox="0 0 16 16" aria-hidden="true"><path :d="playing ? 'M4 3h3v10H4zM9 3h3v10H9z' : 'M4 2.5v11l9-5.5z'"/></svg>
        </button>
        <input ref="slider" type="range" min="0" max="1000" value="0" step="1" aria-label="Time" @input="scrubbed" @keydown.space.prevent="toggle">
        <output ref="clock" aria-live="off">0.000 s</output>
        <label class="stage-pace">Speed
          <select v-model.number="pace"><option v-for="p in paces" :key="p" :value="p">{{ p === 1 ? 'real time' : '1/' + Math.round(1 / p) }}</option></select>
        </label>
        <label v-if="motions.length > 1" class="stage-which">Run
          <select v-model.number="which" @change="choose"><option v-for="(m, i) in motions" :key="m.name" :value="i">{{ m.name }}</option></select>
        </label>
      </div>
      <div class="stage-layers" role="group" aria-label="What is shown">
        <label v-for="layer in layers" :key="layer.id" :class="layer.id"><input type="checkbox" v-model="shown[layer.id]" @change="layered">{{ layer.name }}</label>
      </div>
    </div>`,
  props: { drawn: Object, replay: String, heat: Object, title: String, calm: Boolean, start_s: Number },
  data: () => ({
    motions: [], which: 0, playing: false, pace: 1, paces: PACES, trouble: "", faults: [],
    shown: { twin: true, drawing: true, seen: true, trails: true, joints: true, names: true, forces: true },
  }),
  watch: {
    playing(now) { if (!now) { this.stage.world.sharpen(); this.ask(); } },
  },
  computed: {
    views() {
      const flat = this.drawn.normal ? [{ id: "flat", name: "Flat", title: "Square to the plane of motion" }] : [];
      const name = (id) => ({ id, name: id.toUpperCase(), title: `Along the ${id} axis` });
      return [{ id: "home", name: "3-D", title: "From above, at an angle" }, ...flat, name("x"), name("y"), name("z")];
    },
    layers() {
      const now = this.motions[this.which], list = [];
      if (now) list.push({ id: "twin", name: now.twin || "twin" });
      if (now?.before) list.push({ id: "drawing", name: "as drawn" });
      if (now?.seen) list.push({ id: "seen", name: "measured" }, { id: "trails", name: "paths" });
      if (now?.forces_n) list.push({ id: "forces", name: "joint forces" });
      return [...list, { id: "joints", name: "joints" }, { id: "names", name: "names" }];
    },
  },
  mounted() {
    this.stamps = [];
    this.busy = [];
    Object.assign(this.$el, { stamps: this.stamps, busy: this.busy });
    try {
      this.stage = new Stage(this.$refs.canvas, this.drawn, () => this.ask());
    } catch (error) {
      console.error(error);
      this.trouble = "This browser draws no 3-D picture. Switch hardware acceleration on, or open the page in another browser; all numbers are below.";
      return;
    }
    this.stage.calm = this.calm;
    this.stage.heat = this.heat || {};
    this.stage.paint();
    this.stage.ready.then((found) => {
      const meshes = this.drawn.bodies.flatMap((body) => body.meshes), faults = [...new Set(found.flat())];
      if (!meshes.some(({ url, fault }) => url || fault)) this.trouble = "No meshes came with this drawing: bodies are drawn as bars through their joints.";
      else if (faults.length) {
        this.trouble = "Not every mesh is shown; bodies without one are drawn as bars through their joints.";
        this.faults = [...faults.slice(0, MOST_FAULTS), ...(faults.length > MOST_FAULTS ? [`And ${faults.length - MOST_FAULTS} more.`] : [])];
      }
      this.$el.dataset.ready = "yes";
    });
    this.resized = new ResizeObserver(() => this.stage.world.fit());
    this.resized.observe(this.$refs.view);
    this.ends = [
      onScheme(() => this.stage.paint()), onPart(({ part }) => this.stage.point(part)),
      onAsked(({ motion, time_s }) => this.jump(motion, time_s)),
    ];
    if (this.replay) this.load();
  },
  unmounted() {
    this.playing = false;
    this.ends?.forEach((end) => end());
    this.resized?.disconnect();
    this.stage?.close();
  },
  methods: {
    async load() {
      try {
        const answer = await fetch(this.replay);
        if (!answer.ok) throw new Error(`${answer.status}`);
        this.motions = Object.freeze((await answer.json()).motions.map(Object.freeze));
        await this.$nextTick();
        if (this.motions.length && this.stage) this.choose();
        this.$el.dataset.replay = "yes";
      } catch (error) {
        this.trouble = `The motion could not be read (${error.message}). Reload the page; the numbers below are complete.`;
      }
    },
    choose() {
      const motion = this.motions[this.which], length = motion.time_s.at(-1) - motion.time_s[0];
      this.pace = PACES.find((p) => length / p >= WATCHED_S) ?? PACES.at(-1);
      this.stage.play(motion);
      this.show(this.start_s ?? motion.time_s[0]);
    },
    show(time_s) {
      const { start_s, end_s, name } = this.stage.motion;
      this.time_s = Math.min(end_s, Math.max(start_s, time_s));
      this.stage.show(this.time_s);
      if (this.$refs.slider) {
        this.$refs.slider.value = 1000 * (this.time_s - start_s) / (end_s - start_s || 1);
        this.$refs.slider.setAttribute("aria-valuetext", `${this.time_s.toFixed(3)} seconds`);
        this.$refs.clock.textContent = `${this.time_s.toFixed(3)} s`;
      }
      tellTime(name, this.time_s);
    },
    toggle() {
      this.playing = !this.playing;
      if (!this.playing) return;
      if (this.time_s >= this.stage.motion.end_s - 1e-6) this.show(this.stage.motion.start_s);
      this.before = null;
      this.stamps.length = this.busy.length = 0;
      requestAnimationFrame(this.advance);
    },
    advance(now) {
      if (!this.playing || !this.stage.motion) return;
      const { start_s, end_s } = this.stage.motion;
      let time_s = this.time_s + (this.before === null ? 0 : (now - this.before) / 1000 * this.pace);
      if (time_s > end_s) time_s = start_s;
      if (this.before !== null) this.stage.world.pace(now - this.before);
      this.before = now;
      const began = performance.now();
      this.show(time_s);
      this.draw();
      this.stamps.push(now);
      this.$el.drawn = (this.$el.drawn ?? 0) + 1;
      this.busy.push(performance.now() - began);
      if (this.stamps.length > KEPT) { this.stamps.shift(); this.busy.shift(); }
      requestAnimationFrame(this.advance);
    },
    scrubbed() {
      this.playing = false;
      const { start_s, end_s } = this.stage.motion;
      this.show(start_s + this.$refs.slider.value / 1000 * (end_s - start_s));
    },
    jump(motion, time_s) {
      const i = motion ? this.motions.findIndex((m) => m.name === motion) : this.which;
      if (i < 0 || !this.motions.length) return;
      if (i !== this.which) { this.which = i; this.choose(); }
      this.playing = false;
      this.show(time_s);
    },
    ask() {  // one picture for all that changed since the last
      if (this.asked || this.playing) return;
      this.asked = true;
      requestAnimationFrame(() => { this.asked = false; if (this.stage) this.draw(); });
    },
    draw() {
      this.stage.world.render();
      this.label();
    },
    label() {
      const box = this.$refs.names, named = this.stage.names();
      if (!box) return;
      const room = box.clientWidth;
      while (box.children.length < named.length) box.append(document.createElement("span"));
      while (box.children.length > named.length) box.lastChild.remove();
      named.forEach(([text, x, y, kind], i) => {
        const tag = box.children[i];
        if (tag.textContent !== text) tag.textContent = text;
        if (tag.className !== kind) tag.className = kind;
        const wide = LETTER * text.length + 16, left = x < room && x + wide > room ? x - wide : x; // of what is at the rim, before it
        tag.style.transform = `translate(${left.toFixed(1)}px, ${y.toFixed(1)}px)`;
      });
      const mm = 1000 * this.stage.world.metresPerPixel(), most = 120 * mm;
      if (!(most > 0)) return;
      const power = 10 ** Math.floor(Math.log10(most)), round = [5, 2, 1].find((m) => m * power <= most) * power;
      if (round === this.rounded && mm === this.mm) return;
      this.rounded = round; this.mm = mm;
      this.$refs.scale.firstChild.style.width = `${round / mm}px`;
      this.$refs.scale.lastChild.textContent = round >= 1000 ? `${round / 1000} m` : `${+round.toPrecision(1)} mm`;
    },
    layered() { Object.assign(this.stage.shown, this.shown); this.stage.apply(); },
    look(view) { this.stage.world.look(view); },
    down(event) { this.pressed = [event.offsetX, event.offsetY]; },
    picked(event) {
      if (!this.pressed || Math.hypot(event.offsetX - this.pressed[0], event.offsetY - this.pressed[1]) > 4) return;
      pointAt(this.stage.world.partAt(event.offsetX, event.offsetY));
    },
    turned(event) {
      const turns = { ArrowLeft: [-0.12, 0], ArrowRight: [0.12, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1] };
      if (turns[event.key]) this.stage.world.turn(...turns[event.key]);
      else if (event.key === "+" || event.key === "=") this.stage.world.zoom(1.15);
      else if (event.key === "-") this.stage.world.zoom(1 / 1.15);
      else if (event.key.toLowerCase() === "f") this.look("home");
      else if (event.key === " " && this.motions.length) this.toggle();
      else return;
      event.preventDefault();
    },
  },
};
