// SPDX-License-Identifier: Apache-2.0
// Current and past poses of the robot and its camera, and what they found: path, frustum, landmarks, victim candidates.
import * as THREE from 'three';
import {inks} from '../shared/colours.js';
import {frustum, placed, sides} from '../shared/frustum.js';
import {segments, setSegments} from '../shared/lines.js';
import {theme} from '../shared/theme.js';
import {hasPose} from '../shared/tracking.js';
import {cameraPose, lastTracked, poseOf, store} from './store.js';

const kAxesM = 0.08;

// Runs of consecutive views with a pose: the path does not bridge lost views.
function pathLines(positions) {
  const lines = [];
  for (let i = 1; i < positions.length; ++i) if (positions[i - 1] && positions[i]) lines.push(positions[i - 1], positions[i]);
  return lines;
}

function landmarkPositions() {
  return store.keyframes.flatMap(({pose, landmarks}) => {
    const {position, rotation} = placed(poseOf(pose));
    return landmarks.map((point) => new THREE.Vector3(...point).applyQuaternion(rotation).add(position));
  });
}

function sphereOf({position_m, radius_m}) {
  const sphere = new THREE.LineSegments(
    new THREE.WireframeGeometry(new THREE.IcosahedronGeometry(Math.max(1e-3, radius_m), 1)), new THREE.LineBasicMaterial());
  sphere.position.set(...position_m);
  return sphere;
}

export class Robot {
  constructor() {
    this.path = segments([], 3);
    this.frustum = segments([], 2.5);
    this.pane = new THREE.Mesh(
      new THREE.BufferGeometry(),
      new THREE.MeshBasicMaterial({transparent: true, opacity: 0.08, side: THREE.DoubleSide, depthWrite: false}));
    this.axes = new THREE.AxesHelper(kAxesM);
    this.landmarks = new THREE.Points(new THREE.BufferGeometry(), new THREE.PointsMaterial({size: 5, sizeAttenuation: false}));
    this.candidates = new THREE.Group();
    this.group = new THREE.Group();
    for (const object of [this.axes, this.landmarks, this.pane]) object.frustumCulled = false;
    this.frustum.renderOrder = 2;
    this.group.add(this.path, this.frustum, this.pane, this.axes, this.landmarks, this.candidates);
    this.pose = null;  // the camera's, at the last view with a pose
    this.positions = [];  // the camera's, one per view; null where tracking was lost
    this.seen = {};
  }

  restart() {
    this.pose = null;
    this.positions = [];
    this.seen = {};
  }

  update() {
    const {views, keyframes, candidates} = store;
    // A correction sends new objects for the same views.
    if (views[0] !== this.seen.view) this.positions = [];
    for (let i = this.positions.length; i < views.length; ++i) {
      this.positions.push(views[i].pose ? new THREE.Vector3(...cameraPose(views[i].pose).position) : null);
    }
    setSegments(this.path, pathLines(this.positions));
    const view = lastTracked();
    this.showCamera(view);
    if (keyframes[0] !== this.seen.keyframe || keyframes.length !== this.seen.keyframes) this.showLandmarks();
    if (candidates !== this.seen.candidates) this.showCandidates();
    this.seen = {view: views[0], keyframe: keyframes[0], keyframes: keyframes.length, candidates};
    this.colour();
  }

  showCamera(view) {
    this.pose = view ? cameraPose(view.pose) : null;
    this.axes.visible = this.pane.visible = this.frustum.visible = Boolean(view);
    if (!view) return;
    const {near_m, far_m, corners} = store.about.rig;
    const depth = (near_m + far_m) / 2;
    setSegments(this.frustum, frustum(this.pose, depth, corners));
    this.pane.geometry.setFromPoints(sides(this.pose, depth, corners));
    const {position, rotation} = placed(poseOf(view.pose));
    this.axes.position.copy(position);
    this.axes.quaternion.copy(rotation);
  }

  // A geometry keeps the number of points that it was made with.
  showLandmarks() {
    this.landmarks.geometry.dispose();
    this.landmarks.geometry = new THREE.BufferGeometry().setFromPoints(landmarkPositions());
  }

  showCandidates() {
    for (const sphere of this.candidates.children) {
      sphere.geometry.dispose();
      sphere.material.dispose();
    }
    this.candidates.clear();
    for (const candidate of store.candidates) {
      const sphere = sphereOf(candidate);
      sphere.userData.victim = candidate.victim;
      this.candidates.add(sphere);
    }
  }

  colour() {
    const ink = inks(theme.dark);
    const newest = store.views.at(-1);
    const now = newest && !hasPose(newest) ? ink.lost : ink.chosen;
    this.path.material.color.set(ink.estimate);
    this.frustum.material.color.set(now);
    this.pane.material.color.set(now);
    this.landmarks.material.color.set(ink.truth);
    for (const sphere of this.candidates.children) sphere.material.color.set(sphere.userData.victim ? ink.lost : ink.third);
  }
}
