// SPDX-License-Identifier: Apache-2.0
// Which view is chosen; whoever shows something of it listens.
import {data} from '../shared/data.js';

const listeners = [];
let view = 0;

export const store = {
  get view() {
    return view;
  },
  // A place in data.views; out of range it stays at the end.
  choose(place) {
    view = Math.max(0, Math.min(data.views.length - 1, place));
    for (const listener of listeners) listener(view);
  },
  // Called at once, and after each change.
  onView(listener) {
    listeners.push(listener);
    listener(view);
  },
};

// The place in data.views of a view's index.
const places = new Map(data.views.map((view, place) => [view.index, place]));
export function placeOf(index) {
  return places.get(index);
}
