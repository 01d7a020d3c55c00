// SPDX-License-Identifier: Apache-2.0
// Warm regions that may be victims, each with the reason; scene.js marks them in the map.
import {byId, element} from '../shared/dom.js';
import {fixed} from '../shared/format.js';
import {on, store} from './store.js';

function entry({position_m, radius_m, state, reason}, place) {
  const where = position_m.map((value) => fixed(value, 2)).join(', ');
  return element('li', {}, element('b', {}, `${place + 1}: ${state}`), ` at ${where} m, radius ${fixed(radius_m, 2)} m. ${reason}`);
}

export function showCandidates() {
  on('change', () => {
    byId('candidates').hidden = store.candidates.length === 0;
    byId('candidate-list').replaceChildren(...store.candidates.map(entry));
  });
}
