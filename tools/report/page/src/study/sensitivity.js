// SPDX-License-Identifier: Apache-2.0
// Parameters by their share of the variance, with 95 % intervals.
import {linear} from '../shared/axes.js';
import {axisBelow, chartBox, chartCard, key, label, line, picture, rectangle} from '../shared/chart.js';
import {data} from '../shared/data.js';
import {byId, element, svg} from '../shared/dom.js';
import {percent} from '../shared/format.js';

const kRow = 46;
const kTop = 6;

// Returns [{name, first, first_95, total, total_95}], most important first.
export function ranked(key) {
  const known = data.summary.parameters.map((parameter) => ({name: parameter.name, ...parameter[key]}));
  const weight = ({first, total}) => total ?? first ?? -1;
  return known.sort((a, b) => weight(b) - weight(a));
}

export function sensitivityText(first, first95) {
  return first === null ? '–' : `${percent(first, 0)} (${percent(first95[0], 0)} to ${percent(first95[1], 0)})`;
}

function whisker([low, high], x, y, name) {
  return [line(x(low), y, x(high), y, name), line(x(low), y - 4, x(low), y + 4, name), line(x(high), y - 4, x(high), y + 4, name)];
}

function rowOf(entry, i, x) {
  const top = kTop + i * kRow;
  const y = top + 29;
  const name = label(entry.name, {x: x.to[0], y: top + 14, anchor: 'start', class: 'row-name'});
  const value = label(entry.first === null ? 'unknown' : percent(entry.first, 0), {x: x.to[1], y: top + 14, anchor: 'end', class: 'row-value'});
  if (entry.first === null) return [name, value];
  const parts = [name, value, rectangle(x(0), y - 6, x(Math.max(0, entry.first)) - x(0), 12, 'share'), ...whisker(entry.first_95, x, y, 'whisker')];
  if (entry.total !== null) {
    const at = x(entry.total);
    parts.push(...whisker(entry.total_95, x, y + 8, 'whisker-total'), svg('path', {d: `M${at},${y + 3}l5,5l-5,5l-5,-5z`, class: 'total'}));
  }
  return parts;
}

function drawn(entries, width) {
  const bottom = kTop + entries.length * kRow + 4;
  const ends = entries.flatMap(({first, first_95: a, total, total_95: b}) => [first, ...a, total, ...b]).filter((value) => value !== null);
  const reach = [Math.max(-0.2, Math.min(0, ...ends)), Math.min(1.2, Math.max(0.1, ...ends))];
  const x = linear(reach, [10, width - 12]);
  return picture(width, bottom + 22,
    axisBelow(x, kTop, bottom, {text: (value) => `${Math.round(value * 100)} %`.replace('-', '−')}),
    line(x(0), kTop, x(0), bottom, 'axis'), ...entries.flatMap((entry, i) => rowOf(entry, i, x)));
}

function card(title, aside, which) {
  const entries = ranked(which);
  const description =
      entries.map(({name, first, first_95: first95}) => `${name} ${sensitivityText(first, first95)}`).join('; ');
  return chartCard(title, aside, chartBox(`${title}: ${description}`, (width) => drawn(entries, width)));
}

export function showSensitivity() {
  const totals = data.summary.parameters.some(({of_success: of, of_error: error}) => of.total !== null || error.total !== null);
  byId('sensitivity').append(
    card('Success', 'share of its variance', 'of_success'),
    card('Error', 'share of the variance of its logarithm', 'of_error'));
  const entries = [['share-key', 'first-order Sobol index (the parameter alone), with its 95 % interval']];
  if (totals) entries.push(['whisker-total', 'total Sobol index (including interactions)']);
  byId('sensitivity').after(element('div', {}, key(...entries)));
}
