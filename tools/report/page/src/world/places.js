// SPDX-License-Identifier: Apache-2.0
// Finds what can be dragged: the objects of single entries, and the waypoints, views and start of the trajectory.
// Each has the key path of its position in the scene.
const kPlaces = /^(trajectory\..+\.(?:camera_m|translation_m))\.([012])$/;

// Returns file:line with at most one folder.
export const shortPlace = (place) => place.split('/').slice(-2).join('/');

// Returns [{path, name, position}].
export function waypointsOf({values}) {
  const found = new Map();
  for (const {path, text, changeable} of values) {
    const [, place, axis] = (changeable && path.match(kPlaces)) || [];
    if (!place) continue;
    if (!found.has(place)) found.set(place, {path: place, name: place.replace(/^trajectory\.|\.(camera_m|translation_m)$/g, ''), position: [0, 0, 0]});
    found.get(place).position[Number(axis)] = Number(text);
  }
  return [...found.values()];
}

// Returns the place of an object, or null if its entry yields several objects. The entry's position may differ from the
// object's by an offset.
export function placeOf({values, objects}, index) {
  const object = objects[index];
  if (!object?.path) return null;
  const path = `${object.path}.pose.translation_m`, position = object.pose.slice(0, 3);
  const given = [0, 1, 2].map((axis) => Number(values.find((value) => value.changeable && value.path === `${path}.${axis}`)?.text ?? 0));
  return {path, name: object.name, position, offset: position.map((value, axis) => given[axis] - value)};
}
