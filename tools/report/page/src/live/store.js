// SPDX-License-Identifier: Apache-2.0
// The state received from the server so far (tools/live/live_feed.h describes it); displays register as listeners.
import {placed} from '../shared/frustum.js';

const empty = {
  run: null, sequence: 0, finished: false, dropped: 0, views_per_s: 0, about: null, views: [], keyframes: [], newest: null,
  candidates: [],
};
const listeners = {change: [], restart: []};

export const store = {...empty};

// 'change': after each answer; 'restart': before the first answer of a run; `about` is then known.
export function on(event, listener) {
  listeners[event].push(listener);
}

function tell(event) {
  for (const listener of listeners[event]) listener();
}

// Returns `known` with its entries from `from` on replaced. A run has more views than a call may have arguments.
function replaced(known, {from, list}) {
  return known.slice(0, from).concat(list);
}

export function take(changes) {
  if (changes.about) {
    Object.assign(store, empty, {about: changes.about, views: [], keyframes: [], candidates: []});
    tell('restart');
  }
  const {views, keyframes, ...others} = changes;
  Object.assign(store, {views: replaced(store.views, views), keyframes: replaced(store.keyframes, keyframes)}, others);
  tell('change');
}

// Converts x y z qx qy qz qw to {position, quaternion}.
export function poseOf(numbers) {
  return {position: numbers.slice(0, 3), quaternion: numbers.slice(3)};
}

// Returns the camera's pose for a robot pose.
export function cameraPose(robot) {
  const world = placed(poseOf(robot));
  const mount = placed(poseOf(store.about.rig.robot_from_camera));
  return {
    position: mount.position.applyQuaternion(world.rotation).add(world.position).toArray(),
    quaternion: world.rotation.multiply(mount.rotation).toArray(),
  };
}

// Returns the last view with a pose, or null.
export function lastTracked() {
  for (let i = store.views.length - 1; i >= 0; --i) if (store.views[i].pose) return store.views[i];
  return null;
}
