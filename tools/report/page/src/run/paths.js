// SPDX-License-Identifier: Apache-2.0
// True and estimated camera poses: paths, frusta, and magnified errors.
import * as THREE from 'three';
import {inks} from '../shared/colours.js';
import {data} from '../shared/data.js';
import {frustum, placed, sides} from '../shared/frustum.js';
import {segments, setSegments} from '../shared/lines.js';
import {theme} from '../shared/theme.js';
import {hasPose} from '../shared/tracking.js';
import {store} from './store.js';

const kFrustumShare = 0.14;  // frustum depth of all views but the chosen one, relative to the median depth
const kMaxFrusta = 40;  // more would hide the path

const middle = (data.pictures.near_m + data.pictures.far_m) / 2;

// Runs of consecutive views with a pose: a path does not bridge lost views.
function path(key) {
  const lines = [];
  for (let i = 1; i < data.views.length; ++i) {
    const [a, b] = [data.views[i - 1][key], data.views[i][key]];
    if (a && b) lines.push(placed(a).position, placed(b).position);
  }
  return lines;
}

// Returns 1, 2 or 5 of a decade, such that the largest error is visible.
export function errorScale(size) {
  const largest = Math.max(0, ...data.views.map((view) => view.position_error_mm ?? 0)) / 1000;
  if (largest === 0) return null;
  const wanted = (0.12 * size) / largest;
  const decade = 10 ** Math.floor(Math.log10(wanted));
  return Math.max(1, [5, 2, 1].map((step) => step * decade).find((scale) => scale <= wanted));
}

function errorLines(scale) {
  return data.views.filter((view) => view.pose && view.true_pose).flatMap((view) => {
    const truth = placed(view.true_pose).position;
    const error = placed(view.pose).position.sub(truth);
    return [truth, truth.clone().addScaledVector(error, scale)];
  });
}

// All positions that should be visible.
export function positions() {
  return data.views.flatMap((view) => [view.pose, view.true_pose]).filter(Boolean).map((pose) => placed(pose).position);
}

export function paths(scale) {
  const estimate = segments(path('pose'), 3);
  const dash = Math.max(1e-4, estimate.visible ? pathLength(path('pose')) / 60 : 1);
  const truth = segments(path('true_pose'), 3, {dashed: true, dashSize: dash, gapSize: dash});
  const located = data.views.filter((view) => view.pose);
  const every = Math.ceil(located.length / kMaxFrusta);
  const frusta = segments(
    located.filter((_, i) => i % every === 0).flatMap((view) => frustum(view.pose, kFrustumShare * middle, data.rig.corners)), 1.2);
  const errors = segments(scale ? errorLines(scale) : [], 2);
  const chosen = segments([], 2.5);
  const pane = new THREE.Mesh(
    new THREE.BufferGeometry(),
    new THREE.MeshBasicMaterial({transparent: true, opacity: 0.08, side: THREE.DoubleSide, depthWrite: false}));
  const group = new THREE.Group();
  group.add(estimate, truth, frusta, errors, pane, chosen);
  truth.renderOrder = 1;
  chosen.renderOrder = 2;
  const colour = () => {
    const ink = inks(theme.dark);
    const lost = !hasPose(data.views[store.view]);
    estimate.material.color.set(ink.estimate);
    truth.material.color.set(ink.truth);
    frusta.material.color.set(ink.frustum);
    errors.material.color.set(ink.lost);
    chosen.material.color.set(lost ? ink.lost : ink.chosen);
    pane.material.color.set(lost ? ink.lost : ink.chosen);
  };
  return {
    group, estimate, truth, frusta, errors,
    colour,
    // A view without a pose is shown at its true pose.
    choose(view) {
      const pose = view.pose ?? view.true_pose;
      setSegments(chosen, pose ? frustum(pose, middle, data.rig.corners) : []);
      pane.visible = Boolean(pose);
      if (pose) pane.geometry.setFromPoints(sides(pose, middle, data.rig.corners));
      colour();
    },
  };
}

function pathLength(lines) {
  let length = 0;
  for (let i = 0; i < lines.length; i += 2) length += lines[i].distanceTo(lines[i + 1]);
  return length;
}
