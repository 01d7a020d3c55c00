// SPDX-License-Identifier: Apache-2.0
// Success rate and error against each parameter, for classes of trials with similar values of it.
import {categories, decadesAround, linear, logarithmic} from '../shared/axes.js';
import {axisBelow, axisLeft, chartBox, chartCard, key, line, path, picture, rectangle} from '../shared/chart.js';
import {data} from '../shared/data.js';
import {byId, element, svg} from '../shared/dom.js';
import {amount, percent} from '../shared/format.js';

const kLeft = 52;
const kRight = 16;
const kRate = [18, 138];    // px from the top: rates
const kError = [172, 262];  // errors
const kHeight = 286;
const kLeastHalf = 4;  // minimum half-width of a class, px

const kLaws = {uniform: 'uniformly from', log_uniform: 'log-uniformly from', normal: 'from a normal distribution, range'};

export function drawnText({law, values, low, high}) {
  if (values.length) return law === 'grid' ? `${values.length} values in turn` : `one of ${values.length}`;
  if (low === null) return '';
  return `drawn ${kLaws[law]} ${amount(low)} to ${amount(high)}`;
}

// Returns the scale of a parameter over `to`. Places of classes and trials are numbers or, for choices, indices into
// its values.
export function scaleOf({values, logarithmic: isLog, low, high}, to) {
  if (values.length) return categories(values, to);
  const from = low === high || low === null ? [(low ?? 0) - 1, (high ?? 0) + 1] : [low, high];
  return isLog && from[0] > 0 ? logarithmic(from, to) : linear(from, to);
}

// Choices of long values are numbered on axes, and listed once.
const kLongest = 24;

function isNumbered({values}) {
  return values.some((value) => value.length > kLongest);
}

// Returns a category's number, or its text shortened to fit its width.
export function valueTick(parameter, scale) {
  if (isNumbered(parameter)) return (place) => `${place + 1}`;
  const room = Math.max(3, Math.floor((scale.width ?? 0) / 6.6));
  return (place) => {
    const text = parameter.values[place];
    return text.length > room ? `${text.slice(0, room - 1)}…` : text;
  };
}

// Returns the ends and the centre of a class on the axis.
function extent(scale, {values}, {range}, place) {
  if (values.length) {
    const half = Math.min(24, scale.width * 0.3);
    return {left: scale(place) - half, right: scale(place) + half, middle: scale(place)};
  }
  const [left, right] = range.map(scale);
  const middle = (left + right) / 2;
  return {left: Math.min(left, middle - kLeastHalf), right: Math.max(right, middle + kLeastHalf), middle};
}

function rates(classes, places, y) {
  const parts = classes.filter(({trials}) => trials > 0).flatMap((of) => {
    const {left, right, middle} = places.get(of);
    const [low, high] = of.success_95.map(y);
    const rate = y(of.successes / of.trials);
    return [
      rectangle(left, high, right - left, low - high, 'band'),
      line(left, rate, right, rate, 'rate'),
      line(middle, low, middle, high, 'whisker'),
      dot(middle, rate, 'rate-dot'),
    ];
  });
  return svg('g', {}, ...parts);
}

function dot(cx, cy, name) {
  return svg('circle', {cx, cy, r: 3.5, class: name});
}

function triangle(x, y) {
  return svg('path', {d: `M${x - 4},${y + 3}h8l-4,-7z`, class: 'p90-dot'});
}

function errors(classes, places, y, joined) {
  const points = (of) => classes.filter((c) => of(c) !== null).map((c) => [places.get(c).middle, y(of(c))]);
  const median = points((of) => of.translation_median_mm);
  const p90 = points((of) => of.translation_p90_mm);
  return svg('g', {},
    joined ? path(median, 'median') : null,
    joined ? path(p90, 'p90') : null,
    ...median.map(([cx, cy]) => dot(cx, cy, 'median-dot')),
    ...p90.map(([x, at]) => triangle(x, at)));
}

function hasMotion(classes) {
  return classes.some((of) => of.translation_median_mm !== null);
}

function drawn(parameter, classes, width) {
  const to = [kLeft, width - kRight];
  const x = scaleOf(parameter, to);
  const places = new Map(classes.map((of, place) => [of, extent(x, parameter, of, place)]));
  const rate = linear([0, 1], [kRate[1], kRate[0]]);
  const limit = data.rule.max_translation_mm;
  const measured = hasMotion(classes) && decadesAround(classes.flatMap((of) => [of.translation_median_mm, of.translation_p90_mm, limit]));
  const text = parameter.values.length ? valueTick(parameter, x) : undefined;
  const parts = [
    axisBelow(x, kRate[0], kRate[1], {text: measured ? () => '' : text}),
    axisLeft(rate, ...to, {title: 'success rate', text: (value) => `${Math.round(value * 100)} %`}),
    rates(classes, places, rate),
  ];
  if (!measured) return picture(width, kHeight - kError[1] + kRate[1], ...parts);
  const y = logarithmic(measured, [kError[1], kError[0]]);
  parts.push(axisBelow(x, kError[0], kError[1], {text}), axisLeft(y, ...to, {title: 'translation error, mm', count: 4}),
    errors(classes, places, y, !parameter.values.length));
  if (limit > 0) parts.push(line(to[0], y(limit), to[1], y(limit), 'limit'));
  return picture(width, kHeight, ...parts);
}

function spoken(parameter, classes) {
  const rated = classes.filter(({trials}) => trials > 0).map(({successes, trials}) => successes / trials);
  return `${parameter.name}: ${percent(Math.min(...rated), 0)} to ${percent(Math.max(...rated), 0)} of the trials in its classes succeed. The figures are in the tables.`;
}

export function showParameters() {
  data.parameters.forEach((parameter, p) => {
    const classes = data.summary.parameters[p].classes ?? [];
    if (classes.length === 0) return;
    const box = chartBox(spoken(parameter, classes), (width) => drawn(parameter, classes, width));
    const card = chartCard(parameter.name, drawnText(parameter), box);
    if (isNumbered(parameter))
      card.append(element('ol', {class: 'quiet note'}, ...parameter.values.map((value) => element('li', {}, value))));
    byId('parameters').append(card);
  });
  const moved = data.summary.parameters.some(({classes}) => hasMotion(classes ?? []));
  byId('parameters').after(element('div', {},
    key(['rate', 'success rate with its 95 % interval', rectangle(1, 1, 24, 12, 'band')],
      ...(moved ? [['median', 'median error', dot(13, 7, 'median-dot')], ['p90', '90th percentile', triangle(13, 7)], ['limit', 'study limit']] : []))));
}
