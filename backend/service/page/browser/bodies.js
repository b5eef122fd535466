// Bodies as drawn: their real surfaces with the edges a drawing shows, or bars through the joints where none is known.
import { STLLoader, THREE } from "nicegui-scene";

const loader = new STLLoader();
const MOST_FACETS = 1e6; // of one mesh: finding the edges of so many takes seconds
const CREASE = 28; // degrees between two facets from which their common edge is drawn
const kept = new Map(); // surfaces by address, so that the ghost of the drawing costs no second download

// Corners within one cell of a grid are one corner, and facets that lose theirs are left out: what is finer than a pixel
// costs time and shows nothing. Facets get their normals when drawn.
function crude(corners, cell) {
  const places = [], index = [], known = new Map();
  for (let i = 0; i < corners.length; i += 9) {
    const facet = [0, 3, 6].map((k) => {
      const [x, y, z] = [corners[i + k], corners[i + k + 1], corners[i + k + 2]];
      const key = `${Math.round(x / cell)} ${Math.round(y / cell)} ${Math.round(z / cell)}`;
      if (!known.has(key)) { known.set(key, known.size); places.push(x, y, z); }
      return known.get(key);
    });
    if (new Set(facet).size === 3) index.push(...facet);
  }
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.Float32BufferAttribute(places, 3));
  geometry.setIndex(index);
  return geometry;
}

// What a mesh is drawn of; an error says in a sentence why there is nothing.
async function fetched({ uri, url, fault }) {
  const refuse = (why) => { throw new Error(why ?? `"${uri}" cannot be fetched; reload the page.`); };
  if (!url) refuse(fault ?? `"${uri}" did not come with the drawing.`);
  const answer = await fetch(url).catch(() => refuse());
  if (!answer.ok) refuse(await answer.text());
  const facets = await answer.arrayBuffer();
  if (facets.byteLength > 84 + 50 * MOST_FACETS) refuse(`"${uri}" is too fine to be drawn here; export it with fewer than a million facets.`);
  try {
    const geometry = loader.parse(facets);
    if (geometry.getAttribute("position").count) return geometry;
  } catch { refuse(`"${uri}" is damaged; export it again.`); }
  return refuse(`"${uri}" holds no facets; export the surface.`);
}

function surface(mesh, cell) {
  const scale = mesh.scale_to_m, key = `${mesh.uri} ${mesh.url} ${scale} ${cell}`;
  if (!kept.has(key)) {
    kept.set(key, fetched(mesh).then((geometry) => {
      geometry.scale(scale, scale, scale);
      geometry.computeVertexNormals();
      const less = crude(geometry.getAttribute("position").array, cell);
      return { geometry, less, edges: new THREE.EdgesGeometry(geometry, CREASE) };
    }));
  }
  return kept.get(key);
}

function bar(a, b, radius) {
  const along = new THREE.Vector3().subVectors(b, a);
  const geometry = new THREE.CapsuleGeometry(radius, along.length(), 4, 12);
  const turn = new THREE.Quaternion().setFromUnitVectors(new THREE.Vector3(0, 1, 0), along.clone().normalize());
  geometry.applyQuaternion(turn);
  geometry.translate(...a.clone().add(b).multiplyScalar(0.5).toArray());
  return geometry;
}

// A body without a surface: bars from each of its points to the next along its length.
function bars(points, radius) {
  const spots = points.map((p) => new THREE.Vector3(...p));
  if (!spots.length) return [];
  if (spots.length === 1) {
    const ball = new THREE.SphereGeometry(1.6 * radius, 20, 14);
    ball.translate(...spots[0].toArray());
    return [ball];
  }
  let ends = [spots[0], spots[1]];
  for (const a of spots) for (const b of spots) if (a.distanceTo(b) > ends[0].distanceTo(ends[1])) ends = [a, b];
  const along = ends[1].clone().sub(ends[0]);
  spots.sort((a, b) => a.dot(along) - b.dot(along));
  return spots.slice(1).map((p, i) => [spots[i], p]).filter(([a, b]) => a.distanceTo(b) > 1e-6).map(([a, b]) => bar(a, b, radius));
}

export class Look {
  constructor(opacity = 1) {
    const clear = opacity < 1;
    this.opacity = opacity;
    this.face = new THREE.MeshLambertMaterial({
      flatShading: true, transparent: clear, opacity, depthWrite: !clear, side: THREE.FrontSide,
      polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1,
    });
    this.edge = new THREE.LineBasicMaterial({ transparent: true, opacity: clear ? 0.7 : 0.5 });
  }

  paint(face, edge) {
    this.face.color.set(face);
    this.edge.color.set(edge);
  }

  lit(on) {
    this.face.emissive.set(on ? "#7a7a7a" : "#000000");
    this.face.emissiveIntensity = on ? 0.35 : 0;
  }
}

// Leave out of a body what only a quick machine draws at every frame: edges and fine facets.
export function hurry(group, on) {
  group.traverse((part) => {
    if (part.userData.less) part.geometry = on ? part.userData.less : part.userData.whole;
    if (part.isLineSegments) part.material.visible = !on;
  });
}

// One body in its own frame; `ready` tells what of its real surface could not be found, a sentence each. cell: what is finer may be left out in haste.
export function makeBody(body, look, radius, cell, shy = false) {
  const group = new THREE.Group();
  const add = (geometry, edges, less = geometry) => {
    const face = new THREE.Mesh(geometry, look.face);
    Object.assign(face.userData, { whole: geometry, less });
    face.userData.part = shy ? null : `body:${body.id}`;
    group.add(face);
    if (edges) group.add(new THREE.LineSegments(edges, look.edge));
  };
  const fallback = () => bars(body.points_m, radius).forEach((g) => add(g, null));
  group.position.set(...body.position_m);
  const [w, x, y, z] = body.quaternion_wxyz;
  group.quaternion.set(x, y, z, w);
  if (!body.meshes.length) {
    fallback();
    return { group, ready: Promise.resolve([]) };
  }
  const ready = Promise.allSettled(body.meshes.map((mesh) => surface(mesh, cell))).then((all) => {
    const found = all.flatMap(({ value }) => value ?? []);
    found.forEach(({ geometry, edges, less }) => add(geometry, edges, less));
    if (!found.length) fallback();
    return all.flatMap(({ reason }) => reason?.message ?? []);
  });
  return { group, ready };
}
