// SPDX-License-Identifier: Apache-2.0
// Plots over the views.
import uPlot from 'uplot';
import {inks} from '../shared/colours.js';
import {data} from '../shared/data.js';
import {byId, element} from '../shared/dom.js';
import {figure} from '../shared/format.js';
import {theme} from '../shared/theme.js';
import {hasPose} from '../shared/tracking.js';
import {placeOf, store} from './store.js';

const kHeight = 190;
// 5 and 95 % quantiles of sqrt(e' J e / 6) for an error e at the bound: sqrt(chi-squared with 6 degrees of freedom /
// 6).
const kBoundBand = [0.522, 1.449];

const views = data.views.map((view) => view.index);
const ofViews = (value) => data.views.map((view) => value(view) ?? null);
// Values of the views in which landmarks were detected.
const ofLooks = (value) => ofViews((view) => (view.keypoints_detected > 0 ? value(view) : null));
const motionTo = new Map(data.motions.map((motion) => [motion.current, motion]));
const ofMotions = (value) => data.views.map((view) => {
  const motion = motionTo.get(view.index);
  return (motion && value(motion)) ?? null;
});
const constant = (value) => views.map(() => value);

// {title, unit, second: unit of a second axis, note, curves: [{label, values, ink, second, dashed, dots}], band: [low, high]}
function charts() {
  const list = [];
  if (data.has_truth && data.summary.ate_mm !== null) {
    list.push({
      title: 'Position error',
      unit: 'mm',
      curves: [
        {label: 'error', values: ofViews((view) => view.position_error_mm), ink: 'estimate'},
        {label: 'ATE (RMS)', values: constant(data.summary.ate_mm), ink: 'truth', dashed: true},
      ],
    });
    list.push({
      title: 'Motion error per pair',
      unit: 'mm',
      second: '°',
      curves: [
        {label: 'translation', values: ofMotions((motion) => motion.translation_error_mm), ink: 'estimate'},
        {label: 'rotation', values: ofMotions((motion) => motion.rotation_error_deg), ink: 'truth', second: true},
      ],
    });
    list.push({
      title: 'Error ÷ Cramér-Rao bound',
      unit: '',
      note: 'At the bound, 90 % of the pairs lie in the band.',
      curves: [{label: 'error ÷ bound', values: ofMotions((motion) => motion.error_over_bound), ink: 'estimate'}],
      band: [constant(kBoundBand[0]), constant(kBoundBand[1])],
    });
  }
  if (data.has_truth) {
    list.push({
      title: 'Depth error',
      unit: 'mm',
      note: 'Band: from the median to the 99th percentile of the pixels.',
      curves: [{label: 'median', values: ofViews((view) => view.score?.depth_median_mm), ink: 'estimate'}],
      band: [ofViews((view) => view.score?.depth_median_mm), ofViews((view) => view.score?.depth_p99_mm)],
    });
  }
  list.push({
    title: 'Expected depth noise',
    unit: 'mm',
    note: 'Band: 10 to 90 % of the pixels.',
    curves: [{label: 'median σ', values: ofViews((view) => view.sigma_mm?.[1]), ink: 'estimate'}],
    band: [ofViews((view) => view.sigma_mm?.[0]), ofViews((view) => view.sigma_mm?.[2])],
  });
  list.push({
    title: 'Pixels with depth',
    unit: '%',
    curves: [{label: 'share', values: ofViews((view) => view.valid_share * 100), ink: 'estimate'}],
  });
  list.push({
    title: 'Landmarks',
    unit: '',
    note: 'Views tracked by prediction detect no landmarks.',
    curves: [
      {label: 'keypoints', values: ofLooks((view) => view.keypoints_with_depth), ink: 'estimate', dots: true},
      {label: 'matches', values: ofLooks((view) => view.matches), ink: 'truth', dots: true},
      {label: 'inliers', values: ofLooks((view) => view.inliers), ink: 'third', dots: true},
    ],
  });
  return list;
}

// Draws views without a pose as stripes behind the curves and the chosen view as a line.
function marks(plot) {
  const {ctx, bbox} = plot;
  const ink = inks(theme.dark);
  const half = (plot.valToPos(1, 'x', true) - plot.valToPos(0, 'x', true)) / 2;
  ctx.save();
  ctx.beginPath();
  ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
  ctx.clip();
  ctx.fillStyle = ink.quiet;
  for (const view of data.views) {
    if (hasPose(view)) continue;
    ctx.fillRect(plot.valToPos(view.index, 'x', true) - half, bbox.top, 2 * half, bbox.height);
  }
  ctx.strokeStyle = ink.chosen;
  ctx.lineWidth = 1.5 * devicePixelRatio;
  const x = plot.valToPos(data.views[store.view].index, 'x', true);
  ctx.beginPath();
  ctx.moveTo(x, bbox.top);
  ctx.lineTo(x, bbox.top + bbox.height);
  ctx.stroke();
  ctx.restore();
}

function axis(scale, unit, ink, more = {}) {
  return {
    scale,
    stroke: ink.text,
    grid: {stroke: ink.grid, width: 1},
    ticks: {stroke: ink.grid, width: 1},
    font: '12px system-ui, sans-serif',
    size: 58,
    values: (_, values) => values.map((value) => (value === null ? '' : `${Number(value.toPrecision(4))}`.replace('-', '−'))),
    ...more,
  };
}

function options(chart, width) {
  const ink = inks(theme.dark);
  const points = {show: views.length <= 60, size: 6};
  const format = (_, value) => (value === null ? '–' : figure(value));
  const series = [{label: 'view', value: (_, value) => value ?? '–'}];
  const bands = [];
  for (const curve of chart.curves) {
    series.push({
      label: curve.label,
      scale: curve.second ? 'second' : 'y',
      stroke: ink[curve.ink],
      width: 2,
      dash: curve.dashed ? [6, 5] : undefined,
      points: curve.dashed ? {show: false} : curve.dots ? {show: true, size: 6} : points,
      value: format,
    });
  }
  if (chart.band) {
    const edge = {stroke: 'transparent', points: {show: false}, scale: 'y', value: format};
    series.push({...edge, label: 'from'}, {...edge, label: 'to'});
    bands.push({series: [series.length - 1, series.length - 2], fill: ink.band});
  }
  const fromZero = (_, low, high) => (high === null ? [0, 1] : [Math.min(0, low), Math.max(high * 1.08, 1e-9)]);
  const axes = [axis('x', '', ink, {size: 30, space: 45, incrs: [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000]}), axis('y', chart.unit, ink)];
  if (chart.second) axes.push(axis('second', chart.second, ink, {side: 1, grid: {show: false}, stroke: ink.truth}));
  const reach = [views[0] - 0.5, views[views.length - 1] + 0.5];
  return {
    width,
    height: kHeight,
    scales: {x: {time: false, range: () => reach}, y: {range: fromZero}, second: {range: fromZero}},
    axes,
    series,
    bands,
    legend: {markers: {width: 3}},
    cursor: {drag: {x: false, y: false}, sync: {key: 'views'}},
    hooks: {drawAxes: [marks]},
  };
}

// Text alternative of a chart for screen readers.
function summary(chart) {
  const parts = chart.curves.map(({label, values}) => {
    const known = values.filter((value) => value !== null);
    return known.length ? `${label} ${figure(Math.min(...known))} to ${figure(Math.max(...known))} ${chart.unit}` : `${label} unknown`;
  });
  return `${chart.title}: ${parts.join('; ')}`;
}

function chooseAtCursor(plot) {
  plot.over.addEventListener('click', () => {
    const {idx} = plot.cursor;
    if (idx !== null && idx !== undefined) store.choose(placeOf(views[idx]));
  });
}

export function showPlots() {
  const plots = charts().filter(({curves}) => curves.some(({values}) => values.some((value) => value !== null))).map((chart) => {
    const box = element('div', {class: 'plot', role: 'img', 'aria-label': summary(chart)});
    const units = [chart.unit, chart.second].filter(Boolean).join(', ');
    byId('plots').append(element('figure', {class: 'card'},
      element('figcaption', {}, element('h3', {}, chart.title), element('span', {class: 'quiet'}, units)),
      box, chart.note ? element('p', {class: 'quiet note'}, chart.note) : null));
    return {chart, box, plot: null};
  });
  const width = (box) => Math.max(200, Math.floor(box.clientWidth));
  const draw = () => {
    for (const entry of plots) {
      const {chart, box} = entry;
      entry.plot?.destroy();
      const values = [views, ...chart.curves.map((curve) => curve.values), ...(chart.band ?? [])];
      entry.plot = new uPlot(options(chart, width(box)), values, box);
      chooseAtCursor(entry.plot);
    }
  };
  theme.on(draw);
  store.onView(() => plots.forEach(({plot}) => plot.redraw(false)));
  new ResizeObserver(() => {
    for (const {plot, box} of plots) {
      if (plot && plot.width !== width(box)) plot.setSize({width: width(box), height: kHeight});
    }
  }).observe(byId('plots'));
}
