// What stands beside the bodies: joints by their kind, arrows of force, dots that were seen.
import { THREE } from "nicegui-scene";

const UP = new THREE.Vector3(0, 0, 1);

// A joint in the frame of body B: a ring about its axis, a block along it, a ball or a cube.
export function makeJoint(joint, size, material) {
  const group = new THREE.Group();
  const shapes = {
    revolute: () => [new THREE.TorusGeometry(size, 0.2 * size, 8, 28)],
    cylindrical: () => [new THREE.TorusGeometry(size, 0.2 * size, 8, 28), new THREE.CylinderGeometry(0.3 * size, 0.3 * size, 4 * size, 12).rotateX(Math.PI / 2)],
    prismatic: () => [new THREE.BoxGeometry(1.1 * size, 1.1 * size, 3 * size)],
    spherical: () => [new THREE.SphereGeometry(size, 16, 12)],
    universal: () => [new THREE.CylinderGeometry(0.3 * size, 0.3 * size, 3 * size, 10), new THREE.CylinderGeometry(0.3 * size, 0.3 * size, 3 * size, 10).rotateZ(Math.PI / 2)],
    planar: () => [new THREE.BoxGeometry(3 * size, 3 * size, 0.3 * size)],
    fixed: () => [new THREE.BoxGeometry(1.2 * size, 1.2 * size, 1.2 * size)],
  };
  for (const geometry of (shapes[joint.type] ?? shapes.fixed)()) {
    const mesh = new THREE.Mesh(geometry, material);
    mesh.renderOrder = 5;
    mesh.userData.part = `joint:${joint.id}`;
    group.add(mesh);
  }
  group.position.set(...joint.frame_b.position_m);
  const [w, x, y, z] = joint.frame_b.quaternion_wxyz;
  group.quaternion.set(x, y, z, w);
  return group;
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

export function makeDot(size, material) {
  const dot = new THREE.Mesh(new THREE.SphereGeometry(size, 14, 10), material);
  dot.renderOrder = 10;
  return dot;
}

// A path in space; points that were not seen leave a gap.
export function makeTrail(points, material) {
  const pairs = [];
  for (let i = 1; i < points.length; i++) if (points[i - 1] && points[i]) pairs.push(...points[i - 1], ...points[i]);
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.Float32BufferAttribute(pairs, 3));
  const trail = new THREE.LineSegments(geometry, material);
  trail.renderOrder = 4;
  return trail;
}
