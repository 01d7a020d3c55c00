// SPDX-License-Identifier: Apache-2.0
// Tables in the format of the papers.
import {data} from '../shared/data.js';
import {byId, element} from '../shared/dom.js';
import {count, fixed, percent} from '../shared/format.js';
import {head, scroller} from '../shared/tables.js';
import {stateText} from './scrubber.js';
import {placeOf, store} from './store.js';

const kMotionHead = ['ΔX mm', 'ΔY mm', 'ΔZ mm', 'Δα °', 'Δβ °', 'Δγ °'];

function chooser(index, text) {
  return element('button', {type: 'button', class: 'chooser', onclick: () => store.choose(placeOf(index))}, text);
}

function sixCells(six, digits) {
  return six.map((value, i) => element('td', {}, fixed(value, digits + (i >= 3 && digits > 3 ? 1 : 0))));
}

function motionRows(motion) {
  const lines = [];
  if (motion.true) lines.push(['truth', motion.true, 3]);
  lines.push(['estimate', motion.estimated, 3]);
  if (motion.error) lines.push(['error', motion.error, 4]);
  const body = element('tbody', {'data-view': motion.current});
  lines.forEach(([name, six, digits], i) => {
    const row = element('tr', {class: name});
    if (i === 0) {
      const pair = chooser(motion.current, `${motion.previous} → ${motion.current}`);
      row.append(element('th', {scope: 'rowgroup', rowspan: lines.length}, pair));
    }
    row.append(element('th', {scope: 'row'}, name), ...sixCells(six, digits));
    if (motion.error) row.append(element('td', {}, name === 'error' ? fixed(motion.error_over_bound, 2) : ''));
    body.append(row);
  });
  return body;
}

function motionTable() {
  const titles = ['views', '', ...kMotionHead];
  if (data.motions.some((motion) => motion.error)) titles.push('error ÷ bound');
  return element('table', {}, head(titles), ...data.motions.map(motionRows));
}

function viewColumns() {
  const columns = [
    ['tracking', (view) => stateText(view)],
    ['pixels with depth', (view) => percent(view.valid_share)],
    ['keypoints', (view) => count(view.keypoints_with_depth)],
    ['matches', (view) => count(view.matches)],
    ['inliers', (view) => count(view.inliers)],
    ['noise mm', (view) => fixed(view.sigma_mm?.[1], 4)],
  ];
  if (!data.has_truth) return columns;
  return [
    columns[0],
    ['depth error, median mm', (view) => fixed(view.score?.depth_median_mm, 4)],
    ['RMS mm', (view) => fixed(view.score?.depth_rms_mm, 4)],
    ['99 % mm', (view) => fixed(view.score?.depth_p99_mm, 4)],
    ['lit pixels with depth', (view) => percent(view.score?.valid_fraction, 2)],
    ['wrong fringe order', (view) => view.score?.wrong_order?.toExponential(1).replace('-', '−') ?? '–'],
    ['position error mm', (view) => fixed(view.position_error_mm, 4)],
    ...columns.slice(2),
  ];
}

function viewTable() {
  const columns = viewColumns();
  const rows = data.views.map((view) =>
    element('tr', {'data-view': view.index}, element('th', {scope: 'row'}, chooser(view.index, String(view.index))),
      ...columns.map(([, text]) => element('td', {}, text(view)))));
  return element('table', {}, head(['view', ...columns.map(([title]) => title)]), element('tbody', {}, ...rows));
}

// Scrolls the table, not the page, to the chosen row.
function bringIntoSight(row) {
  const box = row.closest('.scroller');
  const top = row.offsetTop - box.querySelector('thead').offsetHeight;
  if (top < box.scrollTop) box.scrollTop = top;
  const below = row.offsetTop + row.offsetHeight - box.clientHeight;
  if (below > box.scrollTop) box.scrollTop = below;
}

export function showTables() {
  if (data.motions.length > 0) {
    byId('motions').hidden = false;
    byId('motions').append(
      element('p', {class: 'quiet'}, 'Robot motion, previous from current; R = Rz(Δγ) Ry(Δβ) Rx(Δα).'),
      scroller('Motions', motionTable()));
  }
  byId('views').append(scroller('Views', viewTable()));
  store.onView((place) => {
    const index = String(data.views[place].index);
    for (const node of document.querySelectorAll('[data-view]')) {
      const chosen = node.dataset.view === index;
      node.classList.toggle('chosen', chosen);
      if (chosen) bringIntoSight(node);
    }
  });
}
