// SPDX-License-Identifier: Apache-2.0
// The map so far: some points of each keyframe (tools/live/keyframe_points.h), placed by the keyframe's pose, so that
// they need not be sent again after a map correction.
import * as THREE from 'three';
import {amount} from '../shared/format.js';
import {placed} from '../shared/frustum.js';
import {kFieldOfView} from '../shared/orbit.js';
import {byPalette} from '../shared/vertex_colours.js';
import {ask} from './server.js';
import {poseOf, store} from './store.js';

const kWhite = 0.6 * 255;  // white level of the texture
const kMostPoints = 1.5e6;  // beyond this, each keyframe shows fewer
const kMostGrowth = 3;  // of points that stand for others

function decoded(buffer) {
  const head = new DataView(buffer);
  const count = head.getUint32(0, true);
  const positions = Float32Array.from(new Int16Array(buffer, 12, 3 * count), (value) => value * head.getFloat32(4, true));
  const grey = new Uint8Array(buffer, 12 + 6 * count, count);
  const sigma_mm = Float32Array.from(new Uint8Array(buffer, 12 + 7 * count, count), (level) => level * head.getFloat32(8, true) * 1000);
  return shuffled({count, positions, grey, sigma_mm});
}

// Shuffles the points, so that any leading part of them covers the whole keyframe more sparsely.
function shuffled({count, positions, grey, sigma_mm}) {
  const order = Uint32Array.from({length: count}, (_, i) => i);
  let state = 1;
  for (let i = count - 1; i > 0; --i) {
    state = (Math.imul(state, 1664525) + 1013904223) >>> 0;
    const other = state % (i + 1);
    [order[i], order[other]] = [order[other], order[i]];
  }
  return {
    count,
    positions: Float32Array.from({length: 3 * count}, (_, i) => positions[3 * order[Math.floor(i / 3)] + (i % 3)]),
    grey: grey.map((_, i) => grey[order[i]]),
    sigma_mm: sigma_mm.map((_, i) => sigma_mm[order[i]]),
  };
}

function quantiles(values, low, high) {
  const sorted = Float32Array.from(values).sort();
  return [low, high].map((share) => sorted[Math.floor(share * (sorted.length - 1))]);
}

// Rounds up to 1, 2 or 5 of a decade.
function roundUp(value) {
  const decade = 10 ** Math.floor(Math.log10(value));
  return [1, 2, 5, 10].map((step) => step * decade).find((step) => step >= value * 0.999);
}

class Cloud {
  constructor(points) {
    Object.assign(this, points);
    this.pose = null;
    this.geometry = new THREE.BufferGeometry();
    this.geometry.setAttribute('position', new THREE.BufferAttribute(this.positions, 3));
    this.geometry.setAttribute('color', new THREE.BufferAttribute(new Float32Array(3 * this.count), 3));
    this.size = this.spacing();
    this.object = new THREE.Points(this.geometry, new THREE.PointsMaterial({size: this.size, vertexColors: true}));
    this.object.matrixAutoUpdate = false;
    this.sigma = this.count ? quantiles(this.sigma_mm, 0, 0.95)[1] : 0;
  }

  // Point spacing as seen from the keyframe's camera; three.js defines sizes for a field of view of 90 degrees.
  spacing() {
    if (this.count === 0) return 1;
    this.geometry.computeBoundingBox();
    const size = this.geometry.boundingBox.getSize(new THREE.Vector3());
    return (1.2 * Math.sqrt((size.x * size.y) / this.count)) / Math.tan(THREE.MathUtils.degToRad(kFieldOfView / 2));
  }

  // Returns true if it moved.
  place(numbers) {
    const key = numbers.join(' ');
    if (key === this.pose) return false;
    this.pose = key;
    const {position, rotation} = placed(poseOf(numbers));
    this.object.matrix.compose(position, rotation, new THREE.Vector3(1, 1, 1));
    this.object.matrixWorldNeedsUpdate = true;
    this.box = new THREE.Box3().copy(this.geometry.boundingBox ?? new THREE.Box3()).applyMatrix4(this.object.matrix);
    const e = this.object.matrix.elements;
    this.heights = Float32Array.from({length: this.count}, (_, i) =>
      e[2] * this.positions[3 * i] + e[6] * this.positions[3 * i + 1] + e[10] * this.positions[3 * i + 2] + e[14]);
    this.ends = this.count ? quantiles(this.heights, 0.005, 0.995) : [0, 0];
    return true;
  }

  colour(colouring, scale) {
    const attribute = this.geometry.attributes.color;
    if (colouring === 'texture') {
      for (let i = 0; i < this.count; ++i) attribute.array.fill(Math.min(1, this.grey[i] / kWhite), 3 * i, 3 * i + 3);
    } else {
      const values = colouring === 'height' ? this.heights : this.sigma_mm;
      const level = (i) => Math.round(255 * Math.max(0, Math.min(1, (values[i] - scale.low) / (scale.high - scale.low))));
      attribute.array.set(byPalette(this.count, scale.palette, level));
    }
    attribute.needsUpdate = true;
  }

  // Draws a share of the points, larger, so that they cover the same surface.
  limit(share) {
    this.geometry.setDrawRange(0, Math.ceil(share * this.count));
    this.object.material.size = this.size * Math.min(kMostGrowth, 1 / Math.sqrt(share));
  }

  dispose() {
    this.geometry.dispose();
    this.object.material.dispose();
  }
}

export class Clouds {
  // `changed` is called when there is more to draw or something moved.
  constructor(changed) {
    this.changed = changed;
    this.group = new THREE.Group();
    this.clouds = [];
    this.colouring = 'texture';
    this.scale = null;
    this.fetching = false;
    this.share = 1;
  }

  get points() {
    return this.clouds.reduce((sum, cloud) => sum + cloud.count, 0);
  }

  get box() {
    return this.clouds.reduce((box, cloud) => box.union(cloud.box), new THREE.Box3());
  }

  restart() {
    for (const cloud of this.clouds) cloud.dispose();
    this.group.clear();
    this.clouds = [];
    this.scale = null;
  }

  // Fetches missing keyframes one by one and moves those whose pose changed.
  async update() {
    const moved = this.clouds.filter((cloud, i) => store.keyframes[i] && cloud.place(store.keyframes[i].pose));
    if (moved.length) this.recolour(moved);
    if (this.fetching) return;
    this.fetching = true;
    const {run} = store;
    try {
      for (let number; store.run === run && (number = this.missing()) >= 0;) {
        const {version = 0} = store.keyframes[number];
        const answer = await ask(`/keyframe/${number}/points`);
        const buffer = await answer.arrayBuffer();
        if (store.run !== run) break;
        const cloud = new Cloud(decoded(buffer));
        cloud.version = version;
        this.put(number, cloud);
      }
    } catch {
      // The connection reports the error, and the next change asks again.
    }
    this.fetching = false;
  }

  // Number of the first keyframe whose points are missing or belong to an earlier version of its frame; -1: none.
  missing() {
    return store.keyframes.findIndex(({version = 0}, i) => this.clouds[i]?.version !== version);
  }

  put(number, cloud) {
    const old = this.clouds[number];
    if (old) {
      this.group.remove(old.object);
      old.dispose();
    }
    cloud.place(store.keyframes[number].pose);
    this.clouds[number] = cloud;
    this.group.add(cloud.object);
    this.limit();
    this.recolour([cloud]);
  }

  // Draws this share of the points that are drawn at most.
  thin(share) {
    if (share === this.share) return;
    this.share = share;
    this.limit();
  }

  limit() {
    const share = this.share * Math.min(1, kMostPoints / Math.max(1, this.points));
    for (const cloud of this.clouds) cloud.limit(share);
  }

  colourBy(colouring) {
    this.colouring = colouring;
    this.scale = null;
    this.recolour(this.clouds);
  }

  // Recolours the given clouds, or all of them if the scale changes.
  recolour(clouds) {
    const scale = this.neededScale();
    const same = JSON.stringify(scale) === JSON.stringify(this.scale);
    this.scale = scale;
    for (const cloud of same ? clouds : this.clouds) cloud.colour(this.colouring, scale);
    this.changed();
  }

  neededScale() {
    if (this.colouring === 'texture' || this.clouds.length === 0) return null;
    if (this.colouring === 'sigma') {
      return {palette: 'viridis', low: 0, high: roundUp(Math.max(1e-3, ...this.clouds.map(({sigma}) => sigma)))};
    }
    // Rounded outwards, so that a new keyframe rarely changes the scale.
    const [low, high] = [Math.min(...this.clouds.map(({ends}) => ends[0])), Math.max(...this.clouds.map(({ends}) => ends[1]))];
    const step = roundUp(Math.max(1e-4, high - low)) / 20;
    return {palette: 'cividis', low: step * Math.floor(low / step), high: step * Math.ceil(high / step)};
  }

  // Returns the arguments of colourBar(), or null.
  get bar() {
    if (!this.scale) return null;
    const {palette, low, high} = this.scale;
    const unit = this.colouring === 'height' ? 'm' : 'mm';
    return [palette, ...[low, (low + high) / 2, high].map((value) => `${amount(value)} ${unit}`)];
  }
}
