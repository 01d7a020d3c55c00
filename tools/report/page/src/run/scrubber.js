// SPDX-License-Identifier: Apache-2.0
// The bar that selects a view: buttons, slider, and the arrow keys where they have no other function.
import {data} from '../shared/data.js';
import {byId} from '../shared/dom.js';
import {fixed} from '../shared/format.js';
import {store} from './store.js';

const kPlayMs = 600;

const kStates = {
  first: 'first view',
  followed: 'tracked by prediction',
  refined: 'landmarks, refined',
  landmarks: 'landmarks only',
  ambiguous: 'ambiguous',
  lost: 'lost',
};

export function stateText(view) {
  return (kStates[view.tracking] ?? view.tracking) + (view.relocalized ? ', relocalized' : '') +
    (view.recovered ? ', recovered' : '');
}

function labelOf(view) {
  const time = view.time_s === null ? '' : ` · ${fixed(view.time_s, 2)} s`;
  return `View ${view.index} (${store.view + 1} of ${data.views.length})${time} · ${stateText(view)}`;
}

function step(by) {
  store.choose(store.view + by);
}

function togglePlay() {
  const button = byId('play');
  let timer = null;
  const stop = () => {
    clearInterval(timer);
    timer = null;
    button.setAttribute('aria-pressed', 'false');
  };
  return () => {
    if (timer !== null) return stop();
    if (store.view === data.views.length - 1) store.choose(0);
    button.setAttribute('aria-pressed', 'true');
    timer = setInterval(() => {
      step(1);
      if (store.view === data.views.length - 1) stop();
    }, kPlayMs);
  };
}

// Returns true if the focused element uses the arrow keys itself.
function usesArrows(target) {
  return target.closest('input, select, textarea, #scene, .scroller') !== null;
}

export function showScrubber() {
  const slider = byId('slider');
  slider.max = String(Math.max(0, data.views.length - 1));
  slider.addEventListener('input', () => store.choose(Number(slider.value)));
  byId('previous').addEventListener('click', () => step(-1));
  byId('next').addEventListener('click', () => step(1));
  byId('play').addEventListener('click', togglePlay());
  document.addEventListener('keydown', (event) => {
    if (event.altKey || event.ctrlKey || event.metaKey || usesArrows(event.target)) return;
    if (event.key === 'ArrowLeft') step(-1);
    else if (event.key === 'ArrowRight') step(1);
    else return;
    event.preventDefault();
  });
  store.onView((place) => {
    const view = data.views[place];
    slider.value = String(place);
    slider.setAttribute('aria-valuetext', labelOf(view));
    byId('label').textContent = labelOf(view);
    byId('previous').disabled = place === 0;
    byId('next').disabled = place === data.views.length - 1;
  });
}
