// SPDX-License-Identifier: Apache-2.0
// The parameter box with 99 % success: its range next to each parameter's full range.
import {axisBelow, chartBox, label, picture, rectangle} from '../shared/chart.js';
import {data} from '../shared/data.js';
import {byId, element} from '../shared/dom.js';
import {amount, percent, plural} from '../shared/format.js';
import {interval} from './header.js';
import {scaleOf, valueTick} from './parameters.js';

const kRow = 62;

// Text for the safe part of a parameter's range.
export function safeText([low, high] = [null, null]) {
  if (low === null && high === null) return 'full range';
  if (high === null) return `${amount(low)} or more`;
  if (low === null) return `${amount(high)} or less`;
  return `${amount(low)} to ${amount(high)}`;
}

function rowOf(parameter, [low, high], top, width) {
  const to = [10, width - 12];
  const x = scaleOf(parameter, to);
  const left = low === null ? to[0] : Math.max(to[0], x(low));
  const right = high === null ? to[1] : Math.min(to[1], x(high));
  return [
    label(parameter.name, {x: to[0], y: top + 14, anchor: 'start', class: 'row-name'}),
    label(safeText([low, high]), {x: to[1], y: top + 14, anchor: 'end', class: 'row-value'}),
    axisBelow(x, top + 22, top + 36, {width: 90, text: parameter.values.length ? valueTick(parameter, x) : undefined}),
    rectangle(to[0], top + 22, to[1] - to[0], 12, 'whole'),
    rectangle(left, top + 22, right - left, 12, 'safe'),
  ];
}

export function showEnvelope() {
  const {envelope, parameters} = data.summary;
  const place = byId('envelope');
  if (!envelope) {
    place.append(element('p', {}, 'No parameter ranges with 99 % success were found; they must contain at least 30 trials of the half used for the search.'));
    return;
  }
  const ranges = parameters.map(({envelope: range}) => range ?? [null, null]);
  const {successes, trials, success_95: known} = envelope;
  const share = trials ? `${percent(successes / trials)} (95 % interval ${interval(known)})` : 'none';
  place.append(
    element('p', {class: 'lead'}, element('b', {}, share), ` of ${plural(trials, 'trial')} within these ranges succeed, counted in the half of the study that was not used to find them.`),
    element('div', {class: 'card'}, chartBox(
      data.parameters.map(({name}, p) => `${name}: ${safeText(ranges[p])}`).join('; '),
      (width) => picture(width, kRow * ranges.length, ...data.parameters.flatMap((parameter, p) => rowOf(parameter, ranges[p], p * kRow, width))))));
}
