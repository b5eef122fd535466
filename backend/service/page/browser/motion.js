// A recorded motion, sent once: where every body stands at any time between two of its frames.
import { THREE } from "nicegui-scene";

const from = new THREE.Quaternion(), to = new THREE.Quaternion();

export class Motion {
  constructor(sent) {
    Object.assign(this, { name: sent.name, time_s: sent.time_s, sent });
    this.start_s = sent.time_s[0];
    this.end_s = sent.time_s.at(-1);
    this.last = 0;
  }

  // Index of the frame before a time, and how far on the way to the next one it is.
  at(time_s) {
    const t = this.time_s, most = t.length - 2;
    let i = Math.min(this.last, Math.max(most, 0));
    while (i < most && t[i + 1] <= time_s) i++;
    while (i > 0 && t[i] > time_s) i--;
    this.last = i;
    if (most < 0) return [0, 0];
    return [i, Math.min(1, Math.max(0, (time_s - t[i]) / (t[i + 1] - t[i])))];
  }

  place(track, group, [i, part]) {
    const p = track.position_m, q = track.quaternion_wxyz, j = part > 0 ? i + 1 : i;
    const mix = (a, k) => a[3 * i + k] + part * (a[3 * j + k] - a[3 * i + k]);
    group.position.set(mix(p, 0), mix(p, 1), mix(p, 2));
    from.set(q[4 * i + 1], q[4 * i + 2], q[4 * i + 3], q[4 * i]);
    to.set(q[4 * j + 1], q[4 * j + 2], q[4 * j + 3], q[4 * j]);
    group.quaternion.slerpQuaternions(from, to, part);
  }

  vector(series, [i, part]) {
    const j = part > 0 ? i + 1 : i;
    return [0, 1, 2].map((k) => series[3 * i + k] + part * (series[3 * j + k] - series[3 * i + k]));
  }

  // The last frame in which a marker was seen, unless that is too long ago; null then.
  seen(marker, time_s) {
    const t = this.sent.seen?.time_s ?? [];
    let low = 0, high = t.length;
    while (low < high) { const mid = (low + high) >> 1; if (t[mid] <= time_s + 1e-9) low = mid + 1; else high = mid; }
    const i = low - 1;
    if (i < 0) return null;
    const usual = t.length > 1 ? (t.at(-1) - t[0]) / (t.length - 1) : Infinity;
    if (time_s - t[i] > 2.5 * usual) return null;
    const spot = this.sent.seen.markers[marker];
    const a = spot[i], b = spot[i + 1];
    if (!a || !b || i + 1 >= t.length) return a ?? null;
    const part = Math.min(1, (time_s - t[i]) / (t[i + 1] - t[i]));
    return a.map((v, k) => v + part * (b[k] - v));
  }
}
