// SPDX-License-Identifier: Apache-2.0
// What the server told so far (tools/live/live_feed.h says what that is); whoever shows something of it listens.
import {placed} from '../shared/frustum.js';

const empty = {
  run: null, sequence: 0, finished: false, dropped: 0, views_per_s: 0, about: null, views: [], keyframes: [], newest: null,
  candidates: [],
};
const listeners = {change: [], restart: []};

export const store = {...empty};

// 'change': after each answer; 'restart': before it, when it is the first of a run; `about` is known.
export function on(event, listener) {
  listeners[event].push(listener);
}

function tell(event) {
  for (const listener of listeners[event]) listener();
}

export function take(changes) {
  if (changes.about) {
    Object.assign(store, empty, {about: changes.about, views: [], keyframes: [], candidates: []});
    tell('restart');
  }
  const {views, keyframes, ...others} = changes;
  Object.assign(store, others);
  store.views.splice(views.from, Infinity, ...views.list);
  store.keyframes.splice(keyframes.from, Infinity, ...keyframes.list);
  tell('change');
}

// x y z qx qy qz qw as {position, quaternion}.
export function poseOf(numbers) {
  return {position: numbers.slice(0, 3), quaternion: numbers.slice(3)};
}

// Of the camera, where the robot is.
export function cameraPose(robot) {
  const world = placed(poseOf(robot));
  const mount = placed(poseOf(store.about.rig.robot_from_camera));
  return {
    position: mount.position.applyQuaternion(world.rotation).add(world.position).toArray(),
    quaternion: world.rotation.multiply(mount.rotation).toArray(),
  };
}

// The last view with a pose, or null.
export function lastTracked() {
  for (let i = store.views.length - 1; i >= 0; --i) if (store.views[i].pose) return store.views[i];
  return null;
}
