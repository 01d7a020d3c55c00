// SPDX-License-Identifier: Apache-2.0
// Poses {position, quaternion} as three.js objects, and the camera frustum at a pose. `rays`: those of the image's
// corners, (x, y) at depth 1.
import * as THREE from 'three';
import {chain} from './lines.js';

export function placed(pose) {
  return {position: new THREE.Vector3(...pose.position), rotation: new THREE.Quaternion(...pose.quaternion)};
}

// The image's corners at a depth, in the map's frame.
export function corners(pose, depth, rays) {
  const {position, rotation} = placed(pose);
  return rays.map(([x, y]) => new THREE.Vector3(x * depth, y * depth, depth).applyQuaternion(rotation).add(position));
}

// The frustum's edges, two points each.
export function frustum(pose, depth, rays) {
  const tip = placed(pose).position;
  const rim = corners(pose, depth, rays);
  return [...rim.flatMap((corner) => [tip, corner]), ...chain([...rim, rim[0]])];
}

// The frustum's sides, three points each.
export function sides(pose, depth, rays) {
  const tip = placed(pose).position;
  const rim = corners(pose, depth, rays);
  return rim.flatMap((corner, i) => [tip, corner, rim[(i + 1) % rim.length]]);
}
