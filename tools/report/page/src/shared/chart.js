// SPDX-License-Identifier: Apache-2.0
// SVG charts: their colours come from the page's style sheet, in light and dark mode and in print.
import {element, svg} from './dom.js';

// A box filled by `draw(width)` with an SVG, again whenever its width changes.
export function chartBox(label, draw) {
  const box = element('div', {class: 'chart', role: 'img', 'aria-label': label});
  let drawn = 0;
  new ResizeObserver(() => {
    const width = Math.floor(box.clientWidth);
    if (width === drawn || width === 0) return;
    drawn = width;
    box.replaceChildren(draw(width));
  }).observe(box);
  return box;
}

export function picture(width, height, ...parts) {
  return svg('svg', {width, height, viewBox: `0 0 ${width} ${height}`, 'aria-hidden': 'true'}, ...parts);
}

// `place`: {x, y, anchor: start, middle, end, class}.
export function label(text, {x, y, anchor = 'middle', ...more}) {
  return svg('text', {x, y, 'text-anchor': anchor, ...more}, text);
}

export function line(x1, y1, x2, y2, name) {
  return svg('line', {x1, y1, x2, y2, class: name});
}

export function rectangle(x, y, width, height, name) {
  return svg('rect', {x, y, width: Math.max(0, width), height: Math.max(0, height), class: name});
}

export function path(points, name) {
  return svg('path', {d: points.map(([x, y], i) => `${i ? 'L' : 'M'}${x.toFixed(1)},${y.toFixed(1)}`).join(''), class: name});
}

// Ticks are round; all digits are needed to tell those of a narrow range apart.
export function tickText(value) {
  const size = Math.abs(value);
  if (size !== 0 && (size < 1e-4 || size >= 1e5)) return value.toExponential().replace('e+', 'e').replace('-', '−').replace('e-', 'e−');
  return String(value).replace('-', '−');
}

// Ticks and grid lines of a horizontal axis from `top` to `bottom`; labels without enough room are omitted.
export function axisBelow(scale, top, bottom, {text = tickText, width = 46, title} = {}) {
  const parts = [];
  let end = -Infinity;
  for (const tick of scale.ticks(Math.max(2, Math.floor((scale.to[1] - scale.to[0]) / width)))) {
    const x = scale(tick);
    const words = text(tick);
    const half = 3.4 * words.length;
    parts.push(line(x, top, x, bottom, 'grid'));
    if (x - half < end) continue;
    parts.push(label(words, {x, y: bottom + 15, class: 'tick'}));
    end = x + half + 4;
  }
  if (title) parts.push(label(title, {x: scale.to[1], y: bottom + 31, anchor: 'end', class: 'axis-title'}));
  return svg('g', {}, ...parts);
}

export function axisLeft(scale, left, right, {text = tickText, title, count = 4} = {}) {
  const parts = scale.ticks(count).flatMap((tick) => {
    const y = scale(tick);
    return [line(left, y, right, y, 'grid'), label(text(tick), {x: left - 6, y: y + 4, anchor: 'end', class: 'tick'})];
  });
  if (title) parts.push(label(title, {x: left, y: Math.min(...scale.to) - 8, anchor: 'start', class: 'axis-title'}));
  return svg('g', {}, ...parts);
}

// A name such as light.ambient_lux, which may wrap after its dots and underscores.
export function breakable(name) {
  return name.split(/(?<=[._])/).flatMap((part, i) => (i ? [element('wbr'), part] : [part]));
}

// A figure with a heading, a chart and an optional note.
export function chartCard(title, aside, box, note) {
  return element('figure', {class: 'card'},
    element('figcaption', {}, element('h3', {}, ...breakable(title)), aside ? element('span', {class: 'value'}, aside) : null),
    box, note ? element('p', {class: 'quiet note'}, note) : null);
}

// A legend: [[class of the line, text, further marks], …].
export function key(...entries) {
  return element('p', {class: 'quiet note key-line'}, ...entries.map(([name, text, ...more]) => element('span', {class: 'key-entry'},
    svg('svg', {width: 26, height: 14, 'aria-hidden': 'true'}, line(1, 7, 25, 7, name), ...more), text)));
}
