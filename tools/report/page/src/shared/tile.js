// SPDX-License-Identifier: Apache-2.0
import {element} from './dom.js';

// A figure in the page's header.
export function tile(title, value, unit, note) {
  const number = element('dd', {}, element('b', {}, value), unit ? element('span', {class: 'unit'}, ` ${unit}`) : null);
  if (note) number.append(element('small', {}, note));
  return element('div', {class: 'tile'}, element('dt', {}, title), number);
}
