// SPDX-License-Identifier: Apache-2.0
import {element} from './dom.js';

// Wide tables scroll within the page, also by keyboard.
export function scroller(label, table) {
  return element('div', {class: 'scroller', tabindex: '0', role: 'region', 'aria-label': label}, table);
}

export function head(titles) {
  return element('thead', {}, element('tr', {}, ...titles.map((title) => element('th', {scope: 'col'}, title))));
}
