// The mechanism on stage: bodies, joints and names, and a recorded motion with what was seen beside it.
import { THREE } from "nicegui-scene";
import { hurry, Look, makeBody } from "linktwin-page/bodies.js";
import { ink } from "linktwin-page/colours.js";
import { Arrow, dotShape, jointShapes, makePlace, makeTrails, markMaterial, Swarm } from "linktwin-page/marks.js";
import { Motion } from "linktwin-page/motion.js";
import { World } from "linktwin-page/world.js";

const TONES = 8;
const LONGEST = 0.34; // of the mechanism's size: the arrow of the largest force
const SMALLEST = 0.02; // of the largest force: below it an arrow is left out
const NOTHING_N = 1e-9; // forces below that are rounding errors, and no arrow
const BESIDE = 8; // pixels between two joints whose names would cover each other
const DRAWN = 0.32; // opacity of the drawing behind the twin

export class Stage {
  constructor(canvas, drawn, changed) {
    this.drawn = drawn;
    this.world = new World(canvas, changed);
    this.shown = { twin: true, drawing: true, seen: true, trails: true, joints: true, names: true, forces: true };
    this.points = [];
    this.heat = {};
    this.build();
    this.paint();
  }

  // Length from which sizes of marks follow, box of all bodies as drawn.
  measure() {
    const box = new THREE.Box3();
    for (const point of this.drawn.extent_m) box.expandByPoint(new THREE.Vector3(...point));
    const size = box.getSize(new THREE.Vector3()).length() || 0.1;
    return [box.expandByScalar(0.03 * size), size];
  }

  build() {
    const [box, size] = this.measure();
    Object.assign(this, { box, size });
    this.unit = size / 110;
    this.cell = this.unit / 8; // a pixel or so, of the whole mechanism in a window
    this.world.hurried = (on) => { [...this.groups.values(), ...(this.ghosts ?? new Map()).values()].forEach((one) => hurry(one.group ?? one, on)); };
    this.looks = new Map();
    this.groups = new Map();
    const arriving = [];
    for (const body of this.drawn.bodies) {
      const look = new Look();
      const { group, ready } = makeBody(body, look, 0.9 * this.unit, this.cell);
      this.looks.set(body.id, look);
      this.groups.set(body.id, group);
      this.world.scene.add(group);
      arriving.push(ready);
    }
    this.joints = new Map();
    for (const joint of this.drawn.joints) {
      const mark = makePlace(`joint:${joint.id}`, joint.frame_b.position_m, joint.frame_b.quaternion_wxyz);
      this.groups.get(joint.body_b).add(mark);
      this.joints.set(joint.id, mark);
    }
    this.rings = [...new Set(this.drawn.joints.map(({ type }) => type))].flatMap((type) => {
      const alike = this.drawn.joints.filter((joint) => joint.type === type).map(({ id }) => this.joints.get(id));
      return jointShapes(type, 1.15 * this.unit).map((shape) => this.swarm(shape, markMaterial(0.92), alike, 5));
    });
    this.markers = new Map();
    for (const marker of this.drawn.markers) {
      const dot = makePlace(`marker:${marker.id}`, marker.position_m);
      this.groups.get(marker.body).add(dot);
      this.markers.set(marker.id, dot);
    }
    this.spots = this.swarm(dotShape(0.42 * this.unit), markMaterial(0.9), [...this.markers.values()], 10);
    this.world.frame(box, this.drawn.normal);
    this.ready = Promise.all(arriving).then((found) => { this.grow(); return found; });
  }

  swarm(shape, material, places, order) {
    const swarm = new Swarm(shape, material, places, order);
    this.world.scene.add(swarm.mesh);
    this.world.followers.add(swarm);
    return swarm;
  }

  // Real surfaces reach further than the joints: the frame makes room for them.
  grow() {
    const reach = [];
    this.groups.forEach((group) => {
      const box = new THREE.Box3().setFromObject(group);
      if (!box.isEmpty()) reach.push(box);
    });
    reach.forEach((box) => this.box.union(box));
    this.world.frame(this.box, this.drawn.normal, reach);
    if (this.motion) { // it came before some surfaces, and was framed without them
      this.reach();
      this.show(this.time_s);
    }
    this.world.changed();
  }

  paint() {
    const soft = ink("soft"), warm = new THREE.Color(ink("before"));
    this.drawn.bodies.forEach((body, i) => {
      const hot = this.heat[`body:${body.id}`] ?? 0, look = this.looks.get(body.id);
      let face = body.fixed ? ink("steel-held") : this.motion || this.calm ? ink("steel") : ink(`steel-${i % TONES}`);
      if (hot > 0) face = `#${new THREE.Color(face).lerp(warm, 0.15 + 0.85 * hot).getHexString()}`;
      look.paint(face, ink("edge"));
      look.lit(this.pointed === `body:${body.id}`);
    });
    const hot = ({ userData: { part } }) => (this.heat[part] ?? 0) > 0.04 || this.pointed === part;
    const tones = { joint: new THREE.Color(ink("joint")), marker: new THREE.Color(ink("after")) };
    for (const mark of this.joints.values()) {
      const { part } = mark.userData;
      mark.scale.setScalar(this.pointed === part ? 1.9 : 1 + 1.3 * Math.sqrt(this.heat[part] ?? 0));
    }
    for (const dot of this.markers.values()) dot.scale.setScalar(hot(dot) ? 2 : 1);
    this.rings.forEach((rings) => rings.paint((mark) => hot(mark) ? warm : tones.joint));
    this.spots.paint((dot) => hot(dot) ? warm : tones.marker);
    this.ghosts?.forEach(({ look }) => look.paint(ink("before"), ink("before")));
    if (this.dots) { const seen = new THREE.Color(ink("measured")); this.cloud.paint(() => seen); }
    this.trailMaterial?.color.set(soft);
    this.arrowMaterial?.color.set(ink("c6"));
    this.apply();
  }

  // A motion takes the stage; null brings the drawing back.
  play(sent) {
    this.extra?.forEach((object) => object.removeFromParent());
    this.extra = [];
    this.world.followers.delete(this.cloud);
    this.motion = sent ? new Motion(sent) : null;
    this.ghosts = null;
    this.dots = null;
    this.arrows = this.forceNow = null;
    if (!this.motion) return this.paint();
    const add = (object) => { this.world.scene.add(object); this.extra.push(object); return object; };
    if (sent.before) {
      this.ghosts = new Map(this.drawn.bodies.filter((b) => sent.before[b.id]).map((body) => {
        const look = new Look(DRAWN), { group, ready } = makeBody(body, look, 0.8 * this.unit, this.cell, true);
        ready.then(() => this.world.changed());
        return [body.id, { look, group: add(group) }];
      }));
    }
    if (sent.seen) {
      this.trailMaterial = new THREE.LineBasicMaterial({ transparent: true, opacity: 0.55, depthTest: false });
      this.trails = add(makeTrails(Object.values(sent.seen.markers), this.cell / 2, this.trailMaterial));
      this.dots = new Map(Object.keys(sent.seen.markers).map((id) => [id, add(makePlace(null, [0, 0, 0]))]));
      this.cloud = this.swarm(dotShape(0.8 * this.unit), markMaterial(1), [...this.dots.values()], 10);
      this.extra.push(this.cloud.mesh);
    }
    if (sent.forces_n) {
      this.arrowMaterial = markMaterial(0.95);
      this.arrows = new Map(Object.keys(sent.forces_n).map((id) => {
        const arrow = new Arrow(this.arrowMaterial, 0.28 * this.unit);
        add(arrow.group);
        return [id, arrow];
      }));
      const sizes = Object.values(sent.forces_n).flatMap((f) => Array.from({ length: f.length / 3 }, (_, i) => Math.hypot(f[3 * i], f[3 * i + 1], f[3 * i + 2])));
      sizes.sort((a, b) => a - b);
      this.largest = sizes[Math.floor(0.995 * (sizes.length - 1))] || 0; // a blow must not make all else invisible
      this.largest = Math.max(this.largest, NOTHING_N);
    }
    this.reach();
    this.paint();
    this.show(this.motion.start_s);
  }

  // The boxes of all bodies over the motion, so that nothing leaves the frame while it plays.
  reach() {
    const { time_s } = this.motion, boxes = [];
    for (let k = 0; k <= 12; k++) {
      const at = this.motion.at(time_s[0] + k / 12 * (time_s.at(-1) - time_s[0]));
      for (const [body, track] of Object.entries(this.motion.sent.after)) this.motion.place(track, this.groups.get(body), at);
      this.groups.forEach((group) => {
        const box = new THREE.Box3().setFromObject(group);
        if (!box.isEmpty()) boxes.push(box);
      });
      if (this.arrows) this.forces(at);
      this.forceNow?.forEach(([, , tip]) => boxes.push(new THREE.Box3(tip, tip)));
    }
    if (!boxes.length) boxes.push(this.box.clone()); // bodies that are nothing to be seen
    const whole = boxes.reduce((all, box) => all.union(box), new THREE.Box3());
    this.world.frame(whole, this.drawn.normal, boxes);
  }

  show(time_s) {
    this.time_s = time_s;
    if (!this.motion) return;
    const { sent } = this.motion, at = this.motion.at(time_s);
    for (const [body, track] of Object.entries(sent.after)) this.motion.place(track, this.groups.get(body), at);
    this.ghosts?.forEach(({ group }, body) => this.motion.place(sent.before[body], group, at));
    this.dots?.forEach((dot, marker) => {
      const spot = this.motion.seen(marker, time_s);
      dot.visible = Boolean(spot) && this.shown.seen;
      if (spot) dot.position.set(...spot);
    });
    if (this.arrows) this.forces(at);
    this.world.changed();
  }

  forces(at) {
    this.world.scene.updateMatrixWorld();
    const place = new THREE.Vector3();
    this.forceNow = [];
    this.arrows.forEach((arrow, id) => {
      const force = new THREE.Vector3(...this.motion.vector(this.motion.sent.forces_n[id], at)), size = force.length();
      this.joints.get(id).getWorldPosition(place);
      const length = Math.min(size / this.largest, 1.25) * LONGEST * this.size;
      arrow.point(place, size > SMALLEST * this.largest ? force.setLength(length) : force.setScalar(0));
      arrow.group.visible &&= this.shown.forces;
      if (arrow.group.visible) this.forceNow.push([id, size, arrow.tip()]);
    });
    this.forceNow.sort((a, b) => b[1] - a[1]);
  }

  apply() {
    this.groups.forEach((group, id) => group.children.forEach((child) => {
      const part = child.userData.part ?? "";
      if (child.isMesh && part.startsWith("body:") || child.isLineSegments) child.visible = this.shown.twin || !this.motion || !(id in (this.motion?.sent.after ?? {}));
    }));
    this.joints.forEach((mark) => { mark.visible = this.shown.joints; });
    this.markers.forEach((dot) => { dot.visible = this.shown.joints || Boolean(this.motion); });
    this.ghosts?.forEach(({ group }) => { group.visible = this.shown.drawing; });
    if (this.trails) this.trails.visible = this.shown.trails && this.shown.seen;
    if (this.motion && this.time_s !== undefined) this.show(this.time_s);
    this.world.changed();
  }

  point(part) {
    if (part === this.pointed) return;
    this.pointed = part;
    this.paint();
  }

  // Names to be written over the picture: [text, x, y, kind].
  names() {
    if (!this.shown.names) return [];
    const place = new THREE.Vector3(), named = [];
    const room = this.drawn.joints.length <= 14;
    for (const [id, mark] of this.joints) {
      const key = `joint:${id}`, hot = (this.heat[key] ?? 0) > 0.04;
      if (!(room && this.shown.joints) && !hot && this.pointed !== key) continue;
      const [x, y] = this.world.pixel(mark.getWorldPosition(place)), look = hot || this.pointed === key ? "hot" : "joint";
      const same = named.find((one) => Math.hypot(one[1] - x, one[2] - y) < BESIDE);
      if (!same) named.push([id, x, y, look]);
      else named.splice(named.indexOf(same), 1, [`${same[0]}, ${id}`, x, y, look === "hot" ? look : same[3]]);
    }
    for (const [id, dot] of this.markers) {
      const key = `marker:${id}`;
      if ((this.heat[key] ?? 0) > 0.04 || this.pointed === key) named.push([id, ...this.world.pixel(dot.getWorldPosition(place)), "hot"]);
    }
    if (this.pointed?.startsWith("body:")) {
      const id = this.pointed.slice(5), group = this.groups.get(id);
      if (group) named.push([id, ...this.world.pixel(new THREE.Box3().setFromObject(group).getCenter(place)), "hot"]);
    }
    if (this.arrows && this.shown.forces) {
      for (const [, size, tip] of (this.forceNow ?? []).slice(0, 6)) named.push([`${size.toPrecision(3)} N`, ...this.world.pixel(tip), "force"]);
    }
    return named;
  }

  close() {
    this.world.close();
  }
}
