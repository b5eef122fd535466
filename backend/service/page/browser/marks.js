// What stands beside the bodies: joints by their kind, arrows of force, dots that were seen.
import { THREE } from "nicegui-scene";

const WHITE = new THREE.Color(1, 1, 1);
const UP = new THREE.Vector3(0, 0, 1);

const GONE = new THREE.Matrix4().makeScale(0, 0, 0);

// Many of one shape, drawn at once where their places are; each place is an Object3D whose userData.part names it.
export class Swarm {
  constructor(geometry, material, places, order) {
    this.places = places;
    this.mesh = new THREE.InstancedMesh(geometry, material, places.length);
    Object.assign(this.mesh, { renderOrder: order, frustumCulled: false });
    this.mesh.userData.parts = places.map((place) => place.userData.part);
    this.paint(() => WHITE);
  }

  paint(colour) {
    this.places.forEach((place, i) => this.mesh.setColorAt(i, colour(place)));
    if (this.mesh.instanceColor) this.mesh.instanceColor.needsUpdate = true; // there is none of no places
  }

  follow() {
    this.places.forEach((place, i) => this.mesh.setMatrixAt(i, place.visible ? place.matrixWorld : GONE));
    this.mesh.instanceMatrix.needsUpdate = true;
    this.mesh.boundingSphere = null; // of the places before; a ray asks for it
  }
}

// What a kind of joint is drawn as, in the frame of body B: a ring about its axis, a block along it, a ball or a cube.
export function jointShapes(type, size) {
  const shapes = {
    revolute: () => [new THREE.TorusGeometry(size, 0.2 * size, 6, 24)],
    cylindrical: () => [new THREE.TorusGeometry(size, 0.2 * size, 8, 28), new THREE.CylinderGeometry(0.3 * size, 0.3 * size, 4 * size, 12).rotateX(Math.PI / 2)],
    prismatic: () => [new THREE.BoxGeometry(1.1 * size, 1.1 * size, 3 * size)],
    spherical: () => [new THREE.SphereGeometry(size, 16, 12)],
    universal: () => [new THREE.CylinderGeometry(0.3 * size, 0.3 * size, 3 * size, 10), new THREE.CylinderGeometry(0.3 * size, 0.3 * size, 3 * size, 10).rotateZ(Math.PI / 2)],
    planar: () => [new THREE.BoxGeometry(3 * size, 3 * size, 0.3 * size)],
    fixed: () => [new THREE.BoxGeometry(1.2 * size, 1.2 * size, 1.2 * size)],
  };
  return (shapes[type] ?? shapes.fixed)();
}

// Where a thing is on its body.
export function makePlace(part, position_m, quaternion_wxyz = [1, 0, 0, 0]) {
  const place = new THREE.Object3D(), [w, x, y, z] = quaternion_wxyz;
  place.position.set(...position_m);
  place.quaternion.set(x, y, z, w);
  place.userData.part = part;
  return place;
}

export function markMaterial(opacity = 0.95) {
  return new THREE.MeshBasicMaterial({ depthTest: false, transparent: true, opacity });
}

export class Arrow {
  constructor(material, thickness) {
    this.group = new THREE.Group();
    this.shaft = new THREE.Mesh(new THREE.CylinderGeometry(thickness, thickness, 1, 10).rotateX(Math.PI / 2).translate(0, 0, 0.5), material);
    this.head = new THREE.Mesh(new THREE.ConeGeometry(2.6 * thickness, 1, 14).rotateX(Math.PI / 2).translate(0, 0, -0.5), material);
    this.headLength = 7 * thickness;
    this.shaft.renderOrder = this.head.renderOrder = 8;
    this.group.add(this.shaft, this.head);
  }

  point(from, vector) {
    const length = vector.length();
    this.group.visible = length > 1e-9;
    if (!this.group.visible) return;
    const head = Math.min(this.headLength, 0.6 * length);
    this.group.position.copy(from);
    this.group.quaternion.setFromUnitVectors(UP, vector.clone().divideScalar(length));
    this.shaft.scale.set(1, 1, length - head);
    this.head.scale.set(head / this.headLength, head / this.headLength, head);
    this.head.position.set(0, 0, length);
  }

  tip() {
    return new THREE.Vector3(0, 0, this.head.position.z).applyQuaternion(this.group.quaternion).add(this.group.position);
  }
}

export function dotShape(size) { return new THREE.SphereGeometry(size, 12, 8); }

// Paths in space; points that were not seen leave a gap, steps shorter than `least` are taken together.
export function makeTrails(paths, least, material) {
  const pairs = [];
  for (const points of paths) {
    let from = null;
    points.forEach((to, i) => {
      if (from && to && i + 1 < points.length && points[i + 1] && Math.hypot(to[0] - from[0], to[1] - from[1], to[2] - from[2]) < least) return;
      if (from && to) pairs.push(...from, ...to);
      from = to;
    });
  }
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.Float32BufferAttribute(pairs, 3));
  const trail = new THREE.LineSegments(geometry, material);
  trail.renderOrder = 4;
  return trail;
}
