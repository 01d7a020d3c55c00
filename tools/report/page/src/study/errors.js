// SPDX-License-Identifier: Apache-2.0
// Which share of the trials stays below which error.
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

export const kShares = [0.5, 0.9, 0.99];

// The error that this share of the trials is not above.
export function errorAt(points, share) {
  return points.find(([, below]) => below >= share - 1e-9)?.[0] ?? null;
}

// Steps up at each point.
function steps(points, x, y) {
  let below = 0;
  return points.flatMap(([error, share]) => {
    const corner = [[x(error), y(below)], [x(error), y(share)]];
    below = share;
    return corner;
  });
}

function drawn(points, unit, limit, width) {
  const to = [kLeft, width - kRight];
  const x = logarithmic(decadesAround([...points.map(([error]) => error), limit]) ?? [0.1, 1], to);
  const y = linear([0, 1], [kBottom, kTop]);
  const curve = steps(points, x, y);
  const last = [to[1], y(1)];
  const marks = kShares.flatMap((share) => {
    const at = x(errorAt(points, share));
    const right = at < (to[0] + to[1]) / 2;
    return [
      line(at, y(share), at, kBottom, 'marker'),
      rectangle(at - 3, y(share) - 3, 6, 6, 'marker-dot'),
      label(`${Math.round(share * 100)} %: ${figure(errorAt(points, share))}`,
        {x: at + (right ? 8 : -8), y: y(share) + (share > 0.95 ? -5 : 14), anchor: right ? 'start' : 'end', class: 'mark-text'}),
    ];
  });
  return picture(width, kHeight,
    axisBelow(x, kTop, kBottom, {title: `error, ${unit}`}),
    axisLeft(y, ...to, {title: 'trials not above it', text: (share) => `${Math.round(share * 100)} %`}),
    limit > 0 ? line(x(limit), kTop, x(limit), kBottom, 'limit') : null,
    path([[curve[0][0], kBottom], ...curve, last], 'curve'), ...marks);
}

function card(title, unit, {count, none, points}, limit) {
  const note = none > 0 ? `Of ${plural(count, 'trial')}; ${plural(none, 'other')} lost the camera or ended early, and have no motion to measure.` : `Of ${plural(count, 'trial')}.`;
  const told = kShares.map((share) => `${share * 100} % below ${figure(errorAt(points, share))} ${unit}`).join(', ');
  const box = chartBox(`${title}: ${told}`, (width) => drawn(points, unit, limit, width));
  return chartCard(title, 'worst motion of a trial', box, `${note} Dashed: the study's limit, ${limit} ${unit}.`);
}

export function showErrors() {
  const {translation_mm: shift, rotation_deg: turn} = data.curves;
  if (shift.count === 0) {
    byId('errors').textContent = 'No trial has a motion that could be measured.';
    return;
  }
  byId('errors').append(
    card('Translation error', 'mm', shift, data.rule.max_translation_mm),
    card('Rotation error', '°', turn, data.rule.max_rotation_deg));
}
