// SPDX-License-Identifier: Apache-2.0
import {gradient} from './colours.js';
import {element} from './dom.js';

// A colour bar with the values at its ends and middle; the texts include the unit.
export function colourBar(palette, low, middle, high) {
  const strip = element('div', {class: 'strip'});
  strip.style.background = gradient(palette);
  const ends = element('div', {class: 'ends'}, ...[low, middle, high].map((text) => element('span', {}, text)));
  return element('div', {class: 'colour-bar', role: 'img', 'aria-label': `Colours from ${low} to ${high}`}, strip, ends);
}
