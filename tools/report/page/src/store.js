// SPDX-License-Identifier: Apache-2.0
// Which view is chosen, and which theme; whoever shows something of them listens.
import {data} from './data.js';

const listeners = {view: [], theme: []};
const state = {view: 0, dark: false};

export const store = {
  get view() {
    return state.view;
  },
  get dark() {
    return state.dark;
  },
  // A place in data.views; out of range it stays at the end.
  choose(view) {
    state.view = Math.max(0, Math.min(data.views.length - 1, view));
    for (const listener of listeners.view) listener(state.view);
  },
  setDark(dark) {
    state.dark = dark;
    for (const listener of listeners.theme) listener(dark);
  },
  // Called at once, and after each change.
  on(what, listener) {
    listeners[what].push(listener);
    listener(what === 'view' ? state.view : state.dark);
  },
};

// The place in data.views of a view's index.
const places = new Map(data.views.map((view, place) => [view.index, place]));
export function placeOf(index) {
  return places.get(index);
}
