// A clip with what the tracker found drawn over it, frame by frame; the annotated preview where the browser cannot play the clip.
const TONES = { observed: "#3fd06a", ok: "#3fd06a", outlier: "#ff8c1a", occluded: "#ff5a5a", predicted: "#ffc83d" };
const PACES = [1, 0.5, 0.25, 0.1];
const TAIL = 40; // frames of the path behind each dot

export default {
  template: `
    <div class="film">
      <div class="film-view" ref="view">
        <video ref="video" :src="source" muted playsinline preload="auto" @loadedmetadata="begin" @error="failed" @play="playing = true" @pause="playing = false"
               :aria-label="'The clip with ' + names.length + ' tracked dots'"></video>
        <canvas ref="canvas" aria-hidden="true"></canvas>
        <p v-if="trouble" class="film-trouble" role="status">{{ trouble }}</p>
      </div>
      <div class="stage-bar">
        <button type="button" class="stage-play" @click="toggle" :aria-label="playing ? 'Pause' : 'Play'"><svg viewBox="0 0 16 16" aria-hidden="true"><path :d="playing ? 'M4 3h3v10H4zM9 3h3v10H9z' : 'M4 2.5v11l9-5.5z'"/></svg></button>
        <input ref="slider" type="range" min="0" max="1000" value="0" aria-label="Time" @input="scrubbed">
        <output ref="clock">0.000 s</output>
        <label class="stage-pace">Speed <select v-model.number="pace" @change="$refs.video.playbackRate = pace"><option v-for="p in paces" :key="p" :value="p">{{ p === 1 ? 'real time' : '1/' + Math.round(1 / p) }}</option></select></label>
      </div>
    </div>`,
  props: { clip: String, preview: String, tracks: Object, begins: Number, slower: Number },
  data() { return { source: this.clip, playing: false, pace: 0.5, paces: PACES, trouble: "", drawn: this.clip !== this.preview }; },
  computed: { names() { return Object.keys(this.tracks.markers); } },
  mounted() {
    this.seen = new ResizeObserver(() => this.paint());
    this.seen.observe(this.$refs.view);
  },
  unmounted() { this.gone = true; this.seen?.disconnect(); },
  methods: {
    begin() {
      this.$refs.video.playbackRate = this.pace;
      this.$el.dataset.ready = "yes";
      const next = (now, shown) => { if (this.gone) return; this.time = shown.mediaTime; this.paint(); this.$refs.video.requestVideoFrameCallback(next); };
      if (this.$refs.video.requestVideoFrameCallback) this.$refs.video.requestVideoFrameCallback(next);
      this.time = 0;
      this.paint();
    },
    failed() {
      if (this.source === this.preview) { this.trouble = "Neither the clip nor its preview can be played by this browser; download preview.mp4."; return; }
      this.trouble = "This browser cannot play the clip itself: its annotated preview is shown, slower than real time.";
      this.drawn = false;
      this.source = this.preview;
    },
    toggle() { const v = this.$refs.video; if (v.paused) v.play(); else v.pause(); },
    scrubbed() { const v = this.$refs.video; v.pause(); v.currentTime = this.$refs.slider.value / 1000 * (v.duration || 0); },
    at(time) {
      const t = this.tracks.time_s;
      let low = 0, high = t.length - 1;
      while (low < high) { const mid = (low + high + 1) >> 1; if (t[mid] <= time + 1e-4) low = mid; else high = mid - 1; }
      return low;
    },
    paint() {
      const { video, canvas, view } = this.$refs, ratio = window.devicePixelRatio || 1;
      if (!video?.videoWidth) return;
      if (video.duration) this.$refs.slider.value = 1000 * (this.time ?? 0) / video.duration;
      this.$refs.clock.textContent = `${(this.time ?? 0).toFixed(3)} s`;
      const scale = Math.min(view.clientWidth / video.videoWidth, view.clientHeight / video.videoHeight);
      const left = (view.clientWidth - scale * video.videoWidth) / 2, top = (view.clientHeight - scale * video.videoHeight) / 2;
      canvas.width = view.clientWidth * ratio; canvas.height = view.clientHeight * ratio;
      const pen = canvas.getContext("2d");
      pen.scale(ratio, ratio);
      if (!this.drawn) return;
      const times = this.tracks.time_s, since = ((this.time ?? 0) - this.begins) / this.slower;
      if (since < -1e-3 || since > times.at(-1) - times[0] + 0.05) return; // outside the part that was followed
      const i = this.at(since + times[0]);
      const spot = (row) => [left + (row[0] + 0.5) * scale, top + (row[1] + 0.5) * scale];
      for (const [name, { px, status }] of Object.entries(this.tracks.markers)) {
        pen.strokeStyle = TONES.observed; pen.lineWidth = 1.5; pen.globalAlpha = 0.65; pen.beginPath();
        let pen_down = false;
        for (let k = Math.max(0, i - TAIL); k <= i; k++) { if (!px[k]) { pen_down = false; continue; } pen_down ? pen.lineTo(...spot(px[k])) : pen.moveTo(...spot(px[k])); pen_down = true; }
        pen.stroke(); pen.globalAlpha = 1;
        if (!px[i]) continue;
        const [x, y] = spot(px[i]), tone = TONES[status[i]] ?? TONES.observed;
        pen.lineWidth = 4; pen.strokeStyle = "rgba(0,0,0,.55)"; pen.beginPath(); pen.arc(x, y, 8, 0, 7); pen.stroke();
        pen.lineWidth = 2; pen.strokeStyle = tone; pen.beginPath(); pen.arc(x, y, 8, 0, 7); pen.stroke();
        pen.font = "600 12.5px system-ui, sans-serif"; pen.lineWidth = 3; pen.strokeStyle = "rgba(0,0,0,.6)"; pen.strokeText(name, x + 11, y - 8);
        pen.fillStyle = tone; pen.fillText(name, x + 11, y - 8);
      }
    },
  },
};
