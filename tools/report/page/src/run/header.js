// SPDX-License-Identifier: Apache-2.0
import {data} from '../shared/data.js';
import {byId} from '../shared/dom.js';
import {figure, fixed, plural} from '../shared/format.js';
import {tile} from '../shared/tile.js';

function trackedTile() {
  const {views, tracked} = data.summary;
  const lost = views - tracked;
  return tile('Views tracked', `${tracked} of ${views}`, '', lost ? `${lost} lost` : 'none lost');
}

// Tiles of a run without ground truth.
function tilesWithoutTruth() {
  const sigmas = data.views.map((view) => view.sigma_mm?.[1]).filter((sigma) => sigma !== undefined);
  const valid = data.views.map((view) => view.valid_share);
  const median = (values) => [...values].sort((a, b) => a - b)[Math.floor(values.length / 2)];
  return [
    tile('Expected depth noise, median', figure(median(sigmas)), 'mm', 'standard deviation'),
    tile('Pixels with depth, median', fixed(median(valid) * 100, 1), '%'),
    tile('Accuracy', '–', '', 'no ground truth'),
  ];
}

export function showHeader() {
  const {summary} = data;
  byId('name').textContent = data.name;
  byId('about').textContent =
    `Seed ${data.seed} · ${plural(data.views.length, 'view')} · rig ${data.rig.name} · FringeSLAM ${data.version}`;
  const tiles = data.has_truth
    ? [
        tile('ATE', figure(summary.ate_mm), 'mm', 'RMS position error'),
        tile('Translation error, median', figure(summary.translation_mm), 'mm'),
        tile('Rotation error, median', figure(summary.rotation_deg), '°'),
        tile('Error ÷ bound, median', fixed(summary.error_over_bound, 2), '', '0.94 at the Cramér-Rao bound'),
        tile('Depth error, median', figure(summary.depth_mm), 'mm'),
      ]
    : tilesWithoutTruth();
  byId('figures').append(...tiles, trackedTile());
}
