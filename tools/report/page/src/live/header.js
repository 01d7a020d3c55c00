// SPDX-License-Identifier: Apache-2.0
// The header: name, figures, state and warnings.
import {byId, element} from '../shared/dom.js';
import {count, figure, fixed, percent} from '../shared/format.js';
import {tile} from '../shared/tile.js';
import {hasPose} from '../shared/tracking.js';
import {lastTracked, on, store} from './store.js';
import {motionText, trackingText} from './tracking.js';

const kVerbs = {run: 'Mapping', capture: 'Capturing', focus: 'Focusing'};

function tiles() {
  const {about, newest, views} = store;
  const list = [
    tile('Views', count(views.length), about.stacks ? `of ${count(about.stacks)}` : ''),
    tile('Views per second', store.views_per_s > 0 ? figure(store.views_per_s) : '–', '', store.dropped ? `${count(store.dropped)} dropped` : 'none dropped'),
  ];
  if (about.maps) list.push(tile('Keyframes', count(store.keyframes.length)));
  if (!newest) return list;
  list.push(
    tile('Pixels with depth', newest.depth_possible ? percent(newest.valid, 0) : '–', '', newest.depth_possible ? '' : 'not with these patterns'),
    tile('Pixels saturated', percent(newest.saturated)),
    tile('Mean modulation', figure(newest.mean_modulation_dn), `of ${newest.full_scale_dn / 2}`));
  return list;
}

function showTracking() {
  const view = store.views.at(-1);
  const badge = byId('tracking');
  const text = view ? trackingText(view) : '';
  badge.hidden = text === '';
  if (badge.textContent !== text) badge.textContent = text;
  badge.classList.toggle('lost', view !== undefined && !hasPose(view));
}

// The robot's current or last known position.
function showPose() {
  const view = lastTracked();
  if (!view) return void (byId('pose').textContent = '');
  const [qx, qy, qz, qw] = view.pose.slice(3);
  const turn = 2 * Math.atan2(Math.hypot(qx, qy, qz), Math.abs(qw));
  const where = view.pose.slice(0, 3).map((value) => fixed(value, 3)).join(', ');
  const motion = motionText(view);
  byId('pose').textContent =
      `Robot at ${where} m, rotated by ${fixed((turn * 180) / Math.PI, 1)}°${motion && `; moving at ${motion}`}`;
}

function showWarnings() {
  const list = byId('warnings');
  const sentences = store.newest?.warnings ?? [];
  if ([...list.children].map((item) => item.textContent).join('\n') === sentences.join('\n')) return;
  list.replaceChildren(...sentences.map((text) => element('li', {}, text)));
}

export function showHeader() {
  byId('name').textContent = 'FringeSLAM live';
  byId('left-out').textContent = 'Map: some thousand points of each keyframe; the program writes the complete map.';
  on('change', () => {
    const {about, views} = store;
    byId('name').textContent = `${kVerbs[about.verb]} ${about.name}`;
    byId('about').textContent = `Rig ${about.rig.name}`;
    document.title = `${views.length ? `View ${views.at(-1).index} · ` : ''}${about.name} · FringeSLAM live`;
    byId('figures').replaceChildren(...tiles());
    showTracking();
    showPose();
    showWarnings();
  });
}
