// SPDX-License-Identifier: Apache-2.0
// The viewpoint of the 3D view: its initial position and key controls. Mouse and touch use three.js' OrbitControls.
import * as THREE from 'three';
import {OrbitControls} from 'three/addons/controls/OrbitControls.js';
import {reducedMotion} from './dom.js';

export const kFieldOfView = 40;  // degrees, vertical

const kTurn = THREE.MathUtils.degToRad(6);
const kShift = 0.05;  // relative to the distance
const kZoom = 1.15;
const kFlyMs = 500;
const kMargin = 0.92;  // fraction of the picture filled initially

// Viewing direction: from the cameras' side, from above, slightly to their right.
function startDirection(cameras, centre) {
  const mean = cameras.reduce((sum, position) => sum.add(position), new THREE.Vector3());
  const away = cameras.length ? mean.divideScalar(cameras.length).sub(centre).normalize() : new THREE.Vector3(0, -1, 1);
  const level = Math.hypot(away.x, away.y);
  const azimuth = (level > 0.35 ? Math.atan2(away.y, away.x) : -Math.PI / 2) + THREE.MathUtils.degToRad(28);
  const elevation = THREE.MathUtils.clamp(Math.atan2(away.z, level), THREE.MathUtils.degToRad(28), THREE.MathUtils.degToRad(58));
  return new THREE.Vector3(Math.cos(azimuth) * Math.cos(elevation), Math.sin(azimuth) * Math.cos(elevation), Math.sin(elevation));
}

// Paths have more points than a call may have arguments.
const least = (values) => values.reduce((a, b) => Math.min(a, b), Infinity);
const most = (values) => values.reduce((a, b) => Math.max(a, b), -Infinity);

function cornersOf(box) {
  const ends = [box.min, box.max];
  return Array.from({length: 8}, (_, i) => new THREE.Vector3(ends[i & 1].x, ends[(i >> 1) & 1].y, ends[i >> 2].z));
}

// Returns [eye, target] from `direction`, as close as possible with all points inside a picture of these half-widths at
// distance 1.
function wholeInSight(points, centre, direction, wide, tall) {
  const right = new THREE.Vector3(0, 0, 1).cross(direction).normalize();
  const up = direction.clone().cross(right);
  const target = centre.clone();
  let distance = 0;
  for (let round = 0; round < 4; ++round) {
    const seen = points.map((point) => {
      const away = point.clone().sub(target);
      return [away.dot(right), away.dot(up), away.dot(direction)];
    });
    distance = Math.max(1e-3, most(seen.map(([x, y, near]) => near + Math.max(Math.abs(x) / wide, Math.abs(y) / tall))));
    const middle = (axis) => {
      const slopes = seen.map((point) => point[axis] / (distance - point[2]));
      return ((least(slopes) + most(slopes)) / 2) * distance;
    };
    if (round < 3) target.addScaledVector(right, middle(0)).addScaledVector(up, middle(1));
  }
  return [target.clone().addScaledVector(direction, distance), target];
}

export class Orbit {
  // `box`: bounds of the map; `cameras`: positions; `redraw` is called when the viewpoint moves.
  constructor(canvas, box, cameras, redraw) {
    this.redraw = redraw;
    this.touched = false;
    this.flight = null;
    this.camera = new THREE.PerspectiveCamera(kFieldOfView);
    this.camera.up.set(0, 0, 1);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.enableDamping = !reducedMotion();
    this.controls.dampingFactor = 0.12;
    this.controls.zoomToCursor = true;
    this.controls.addEventListener('change', redraw);
    this.controls.addEventListener('start', () => (this.touched = true));
    this.around(box, cameras);
    canvas.addEventListener('keydown', (event) => this.key(event));
    canvas.addEventListener('pointerdown', () => (this.flight = null));
  }

  // Sets the bounds of another or larger map. A viewpoint chosen by the user is kept.
  around(box, cameras) {
    this.points = [...cornersOf(box), ...cameras];
    const sphere = new THREE.Sphere().setFromPoints(this.points);
    sphere.radius = Math.max(sphere.radius, 1e-3);
    this.centre = sphere.center;
    this.direction = startDirection(cameras, sphere.center);
    this.camera.near = sphere.radius / 500;
    this.camera.far = sphere.radius * 40;
    this.camera.updateProjectionMatrix();
    this.controls.maxDistance = sphere.radius * 15;
    this.controls.minDistance = sphere.radius / 100;
    if (!this.touched) this.reset();
  }

  resize(width, height) {
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    if (!this.touched) this.reset();
    this.redraw();
  }

  reset() {
    this.touched = false;
    const tall = kMargin * Math.tan(THREE.MathUtils.degToRad(this.camera.fov) / 2);
    this.put(...wholeInSight(this.points, this.centre, this.direction, tall * this.camera.aspect, tall));
  }

  put(position, target) {
    this.flight = null;
    this.camera.position.copy(position);
    this.controls.target.copy(target);
    this.controls.update();
    this.redraw();
  }

  // Moves to a view's camera pose, with the target at `depth`.
  flyTo(pose, depth) {
    const tip = new THREE.Vector3(...pose.position);
    const ahead = new THREE.Vector3(0, 0, 1).applyQuaternion(new THREE.Quaternion(...pose.quaternion));
    const target = tip.clone().addScaledVector(ahead, depth);
    // Slightly further back, so that the frustum is visible.
    const eye = tip.addScaledVector(ahead, -0.25 * depth);
    this.touched = true;
    if (reducedMotion()) return this.put(eye, target);
    this.flight = {from: [this.camera.position.clone(), this.controls.target.clone()], to: [eye, target], start: performance.now()};
    this.redraw();
  }

  // Called once per frame; returns true while an animation is running.
  update(now) {
    if (this.flight) {
      const {from, to, start} = this.flight;
      const share = Math.min(1, Math.max(0, (now - start) / kFlyMs));
      const eased = share * share * (3 - 2 * share);
      this.camera.position.lerpVectors(from[0], to[0], eased);
      this.controls.target.lerpVectors(from[1], to[1], eased);
      if (share === 1) this.flight = null;
    }
    return this.controls.update() || this.flight !== null;
  }

  key(event) {
    if (event.altKey || event.ctrlKey || event.metaKey) return;
    const moves = {
      ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1],
    }[event.key];
    if (moves && event.shiftKey) this.shift(...moves);
    else if (moves) this.turn(...moves);
    else if (event.key === '+' || event.key === '=') this.zoom(1 / kZoom);
    else if (event.key === '-') this.zoom(kZoom);
    else if (event.key === 'r' || event.key === 'R' || event.key === 'Home') this.reset();
    else return;
    event.preventDefault();
  }

  // Moves the viewpoint along with an object.
  moveBy(move) {
    this.put(this.camera.position.clone().add(move), this.controls.target.clone().add(move));
  }

  turn(right, up) {
    const offset = this.camera.position.clone().sub(this.controls.target);
    const level = Math.hypot(offset.x, offset.y);
    const azimuth = Math.atan2(offset.y, offset.x) + right * kTurn;
    const limit = Math.PI / 2 - 0.01;
    const elevation = THREE.MathUtils.clamp(Math.atan2(offset.z, level) + up * kTurn, -limit, limit);
    const distance = offset.length();
    offset.set(Math.cos(azimuth) * Math.cos(elevation), Math.sin(azimuth) * Math.cos(elevation), Math.sin(elevation));
    this.touched = true;
    this.put(this.controls.target.clone().addScaledVector(offset, distance), this.controls.target.clone());
  }

  shift(right, up) {
    const distance = this.camera.position.distanceTo(this.controls.target);
    const move = new THREE.Vector3(right, up, 0).multiplyScalar(kShift * distance).applyQuaternion(this.camera.quaternion);
    this.touched = true;
    this.moveBy(move);
  }

  zoom(factor) {
    const offset = this.camera.position.clone().sub(this.controls.target);
    offset.setLength(THREE.MathUtils.clamp(offset.length() * factor, this.controls.minDistance, this.controls.maxDistance));
    this.touched = true;
    this.put(this.controls.target.clone().add(offset), this.controls.target.clone());
  }
}
