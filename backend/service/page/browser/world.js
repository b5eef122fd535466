// A scene that is drawn only when something changed: camera, light, scale bar and the views an engineer asks for.
import { OrbitControls, THREE } from "nicegui-scene";

const ROOM = 1.12; // of the mechanism's own size, so that nothing touches the frame
const MOST_PIXELS = 2; // sharper than that costs time and shows no more
const FLUENT_MS = 18.5; // between two frames while it plays: 60 a second, and a little
const COARSEST = 0.6; // of the screen's own pixels
const JUDGED_MS = 500; // of a very slow machine
const JUDGED = 12; // frames before the next change of coarseness

// A machine without a graphics card draws every pixel by its processor: it gets one sample for each.
function isSoftware() {
  const gl = document.createElement("canvas").getContext("webgl2");
  const known = gl?.getExtension("WEBGL_debug_renderer_info");
  return /swiftshader|llvmpipe|software|basic render/i.test(known ? gl.getParameter(known.UNMASKED_RENDERER_WEBGL) : "");
}

export class World {
  constructor(canvas, changed) {
    this.canvas = canvas;
    this.changed = changed;
    const software = isSoftware();
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: !software, alpha: true, powerPreference: "high-performance" });
    this.sharp = software ? 1 : Math.min(window.devicePixelRatio || 1, MOST_PIXELS);
    this.coarse = 1;
    this.paces = [];
    this.hurry = false;
    this.hurried = () => {}; // told when to leave out what is fine, and when not
    this.renderer.setPixelRatio(this.sharp);
    this.scene = new THREE.Scene();
    this.scene.matrixWorldAutoUpdate = false; // once a frame, for all that follows
    this.followers = new Set();
    this.camera = new THREE.OrthographicCamera(-1, 1, 1, -1, 0.01, 10);
    this.camera.up.set(0, 0, 1);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.enableDamping = false;
    this.controls.addEventListener("change", changed);
    const sky = new THREE.HemisphereLight(0xffffff, 0x9aa4ae, 1.5);
    sky.position.set(0, 0, 1);
    this.lamp = new THREE.DirectionalLight(0xffffff, 1.9);
    this.scene.add(sky, this.lamp, this.lamp.target);
    this.center = new THREE.Vector3();
    this.radius = 0.1;
    this.box = new THREE.Box3();
  }

  // What must be in view (boxes: its parts), and the direction in which a planar mechanism is seen flat.
  frame(box, normal, boxes = [box]) {
    this.box.copy(box);
    this.boxes = boxes.length ? boxes : [box];
    box.getCenter(this.center);
    this.radius = Math.max(box.getSize(new THREE.Vector3()).length() / 2, 1e-6);
    this.normal = normal ? new THREE.Vector3(...normal) : null;
    this.look("home");
  }

  look(view) {
    const flat = this.normal ?? new THREE.Vector3(-0.45, -0.8, 0.5);
    const front = flat.clone();
    if (this.normal && (front.y > 0.5 || front.z < -0.5 || front.x < -0.5)) front.negate(); // seen from the near side
    const side = Math.abs(front.z) > 0.9 ? new THREE.Vector3(0, -1, 0) : new THREE.Vector3(0, 0, 1);
    const across = new THREE.Vector3().crossVectors(side, front).normalize();
    const tilted = front.clone().addScaledVector(side, 0.32).addScaledVector(across, 0.38);
    const directions = {
      home: this.normal ? tilted : flat,
      flat: front,
      x: new THREE.Vector3(1, 0, 0), y: new THREE.Vector3(0, -1, 0), z: new THREE.Vector3(0, -1e-4, 1),
    };
    const direction = (directions[view] ?? directions.home).clone();
    if (Math.abs(direction.z) > 0.9999) direction.y -= 1e-4; // straight down, the camera would not know what is up
    direction.normalize();
    this.camera.position.copy(this.center).addScaledVector(direction, 4 * this.radius);
    this.camera.near = 0.05 * this.radius;
    this.camera.far = 12 * this.radius;
    this.controls.target.copy(this.center);
    this.camera.lookAt(this.center);
    this.camera.updateMatrixWorld();
    this.fit();
  }

  // Zoom so that the box fills the frame as seen from where the camera stands.
  fit() {
    this.resize();
    this.camera.updateMatrixWorld();
    const inverse = this.camera.matrixWorld.clone().invert();
    const seen = new THREE.Box3();
    for (const box of this.boxes) {
      for (let i = 0; i < 8; i++) {
        const corner = new THREE.Vector3(i & 1 ? box.max.x : box.min.x, i & 2 ? box.max.y : box.min.y, i & 4 ? box.max.z : box.min.z);
        seen.expandByPoint(corner.applyMatrix4(inverse));
      }
    }
    const size = seen.getSize(new THREE.Vector3());
    const aspect = this.aspect ?? 1.6;
    const shift = seen.getCenter(new THREE.Vector3()).setZ(0).applyQuaternion(this.camera.quaternion);
    this.camera.position.add(shift); // the middle of what is seen, not of the box
    this.controls.target.add(shift);
    this.half = ROOM * 0.5 * Math.max(size.y, size.x / aspect, 1e-6);
    this.camera.zoom = 1;
    this.resize();
    this.controls.update();
  }

  zoom(factor) {
    this.camera.zoom = Math.min(50, Math.max(0.2, this.camera.zoom * factor));
    this.camera.updateProjectionMatrix();
    this.changed();
  }

  turn(azimuth, polar) {
    const offset = this.camera.position.clone().sub(this.controls.target);
    const ball = new THREE.Spherical().setFromVector3(new THREE.Vector3(offset.x, offset.z, -offset.y));
    ball.theta += azimuth;
    ball.phi = Math.min(Math.PI - 0.01, Math.max(0.01, ball.phi + polar));
    const back = new THREE.Vector3().setFromSpherical(ball);
    this.camera.position.copy(this.controls.target).add(new THREE.Vector3(back.x, -back.z, back.y));
    this.controls.update();
    this.changed();
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.canvas.parentElement;
    if (!width || !height) return;
    this.renderer.setSize(width, height, false);
    this.aspect = width / height;
    const half = this.half ?? this.radius;
    Object.assign(this.camera, { left: -half * this.aspect, right: half * this.aspect, top: half, bottom: -half });
    this.camera.updateProjectionMatrix();
    this.changed();
  }

  render() {
    this.lamp.position.copy(this.camera.position).addScaledVector(this.camera.up, 2 * this.radius);
    this.lamp.target.position.copy(this.center);
    this.scene.updateMatrixWorld();
    this.followers.forEach((swarm) => swarm.follow());
    this.renderer.render(this.scene, this.camera);
  }

  // Told how long each frame took while it plays: draws coarser where the machine cannot follow.
  pace(ms) {
    this.paces.push(ms);
    if (this.paces.length < JUDGED && this.paces.length * ms < JUDGED_MS) return;
    const usual = this.paces.sort((a, b) => a - b)[Math.floor(this.paces.length / 2)];
    this.paces = [];
    if (usual <= FLUENT_MS) return;
    if (!this.hurry) this.hurried(this.hurry = true);
    else if (this.coarse > COARSEST) this.coarser(Math.max(COARSEST, this.coarse * Math.max(0.6, Math.sqrt(FLUENT_MS / usual))));
  }

  // As fine as can be again, once it stands.
  sharpen() {
    if (this.hurry) this.hurried(this.hurry = false);
    this.coarser(1);
  }

  coarser(coarse) {
    this.paces = [];
    if (coarse === this.coarse) return;
    this.coarse = coarse;
    this.renderer.setPixelRatio(this.sharp * coarse);
  }

  // World point to pixels of the frame.
  pixel(point) {
    const seen = point.clone().project(this.camera);
    const { clientWidth: width, clientHeight: height } = this.canvas;
    return [(seen.x + 1) / 2 * width, (1 - seen.y) / 2 * height];
  }

  metresPerPixel() {
    return (this.camera.top - this.camera.bottom) / this.camera.zoom / Math.max(this.canvas.clientHeight, 1);
  }

  // The nearest object under a pixel that belongs to a part.
  partAt(x, y) {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    const ray = new THREE.Raycaster();
    ray.setFromCamera(new THREE.Vector2(2 * x / width - 1, 1 - 2 * y / height), this.camera);
    for (const hit of ray.intersectObjects(this.scene.children, true)) {
      const { part, parts } = hit.object.userData, found = parts ? parts[hit.instanceId] : part;
      if (found && hit.object.visible) return found;
    }
    return null;
  }

  close() {
    this.controls.dispose();
    this.renderer.dispose();
    this.renderer.forceContextLoss(); // a browser grants sixteen; garbage keeps its own for a while
  }
}
