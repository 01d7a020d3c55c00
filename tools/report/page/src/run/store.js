// SPDX-License-Identifier: Apache-2.0
// The chosen view; displays register as listeners.
import {data} from '../shared/data.js';

const listeners = [];
let view = 0;

export const store = {
  get view() {
    return view;
  },
  // Selects an index into data.views, clamped to its range.
  choose(place) {
    view = Math.max(0, Math.min(data.views.length - 1, place));
    for (const listener of listeners) listener(view);
  },
  // The listener is called immediately and after each change.
  onView(listener) {
    listeners.push(listener);
    listener(view);
  },
};

// Returns the position in data.views of a view index.
const places = new Map(data.views.map((view, place) => [view.index, place]));
export function placeOf(index) {
  return places.get(index);
}
