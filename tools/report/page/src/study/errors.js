// SPDX-License-Identifier: Apache-2.0
// Cumulative distributions of the trials' errors.
import {decadesAround, linear, logarithmic} from '../shared/axes.js';
import {axisBelow, axisLeft, chartBox, chartCard, label, line, path, picture, rectangle} from '../shared/chart.js';
import {data} from '../shared/data.js';
import {byId} from '../shared/dom.js';
import {figure, plural} from '../shared/format.js';

const kLeft = 52;
const kRight = 14;
const kTop = 22;
const kBottom = 190;
const kHeight = 228;

// Converts points to a step function.
function steps(points, x, y) {
  let below = 0;
  return points.flatMap(([error, share]) => {
    const corner = [[x(error), y(below)], [x(error), y(share)]];
    below = share;
    return corner;
  });
}

// Marks a percentile: above the curve, where there is room, or below it at the left end.
function percentileMark([percent, error], x, y) {
  const at = x(error);
  const height = y(percent / 100);
  const isLeft = at < kLeft + 90;
  return [
    line(at, height, at, kBottom, 'marker'),
    rectangle(at - 3, height - 3, 6, 6, 'marker-dot'),
    label(`${percent} %: ${figure(error)}`, {x: at + (isLeft ? 8 : -8), y: height + (isLeft ? 15 : -4), anchor: isLeft ? 'start' : 'end', class: 'mark-text'}),
  ];
}

function drawn({points, percentiles}, unit, limit, width) {
  const to = [kLeft, width - kRight];
  const x = logarithmic(decadesAround([...points.map(([error]) => error), limit]) ?? [0.1, 1], to);
  const y = linear([0, 1], [kBottom, kTop]);
  const curve = steps(points, x, y);
  const last = [to[1], y(1)];
  return picture(width, kHeight,
    axisBelow(x, kTop, kBottom, {title: `error, ${unit}`}),
    axisLeft(y, ...to, {title: 'trials up to this error', text: (share) => `${Math.round(share * 100)} %`}),
    limit > 0 ? line(x(limit), kTop, x(limit), kBottom, 'limit') : null,
    path([[curve[0][0], kBottom], ...curve, last], 'curve'), ...percentiles.flatMap((percentile) => percentileMark(percentile, x, y)));
}

function card(title, unit, curve, limit) {
  const {count, none, percentiles} = curve;
  const note = none > 0 ? `Of ${plural(count, 'trial')}; ${plural(none, 'other')} lost tracking or ended early, and have no motion to measure.` : `Of ${plural(count, 'trial')}.`;
  const description = percentiles.map(([percent, error]) => `${percent} % below ${figure(error)} ${unit}`).join(', ');
  const box = chartBox(`${title}: ${description}`, (width) => drawn(curve, unit, limit, width));
  return chartCard(title, 'worst motion of each trial', box, `${note} Dashed: the study's limit, ${limit} ${unit}.`);
}

export function showErrors() {
  const {translation_mm: shift, rotation_deg: turn} = data.curves;
  if (shift.count === 0) {
    byId('errors').textContent = 'No trial has a measurable motion.';
    return;
  }
  byId('errors').append(
    card('Translation error', 'mm', shift, data.rule.max_translation_mm),
    card('Rotation error', '°', turn, data.rule.max_rotation_deg));
}
