// SPDX-License-Identifier: Apache-2.0
// Loss of tracking, relocalization and loop closures, newest first.
import {byId, element} from '../shared/dom.js';
import {on, store} from './store.js';
import {trackingEvents} from './tracking.js';

const kMost = 50;

export function showHistory() {
  let shown = '';
  on('change', () => {
    const events = trackingEvents(store.views).slice(-kMost).reverse();
    const key = JSON.stringify(events);
    if (key === shown) return;
    shown = key;
    byId('history').hidden = events.length === 0;
    byId('events').replaceChildren(...events.map(({index, lost, text}) =>
      element('li', {class: lost ? 'lost' : ''}, `View ${index}: ${text}`)));
  });
}
