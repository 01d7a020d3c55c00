// SPDX-License-Identifier: Apache-2.0
// Facts about the chosen view.
import {element} from '../shared/dom.js';
import {count, figure, fixed, percent} from '../shared/format.js';
import {hasPose} from '../shared/tracking.js';
import {stateText} from './scrubber.js';

const kDegrees = 180 / Math.PI;

function rows(view) {
  const {score} = view;
  const list = [];
  const row = (title, text) => list.push([title, text]);
  if (view.position_error_mm !== null) row('Position error', `${figure(view.position_error_mm)} mm`);
  if (score) row('Depth error, median', `${figure(score.depth_median_mm)} mm`);
  if (score) row('Depth error, 99 %', `${figure(score.depth_p99_mm)} mm`);
  if (view.sigma_mm) row('Expected noise, median', `${figure(view.sigma_mm[1])} mm`);
  row('Pixels with depth', percent(view.valid_share));
  row('Images', String(view.images));
  row('Fringe orders from', view.unwrapping);
  if (view.motion_unknown) row('Motion during the stack', 'unknown');
  if (view.speed_m_s > 0) {
    row('Speed', `${fixed(view.speed_m_s, 3)} ± ${fixed(view.speed_sigma_m_s, 3)} m/s`);
    row('Turn rate', `${fixed(view.turn_rad_s * kDegrees, 2)} ± ${fixed(view.turn_sigma_rad_s * kDegrees, 2)} °/s`);
  }
  row('Keypoints with depth', count(view.keypoints_with_depth));
  if (view.matches) row('Matches, inliers', `${count(view.matches)}, ${count(view.inliers)}`);
  if (view.reference !== undefined) row('Reference keyframe', String(view.reference));
  if (view.icp_pairs) row('ICP overlap', percent(view.icp_overlap, 0));
  if (view.icp_pairs) row('ICP residual ÷ σ', fixed(view.icp_rms_sigma, 2));
  if (view.loops) row('Loops closed', String(view.loops));
  if (view.undetermined) row('Undetermined', view.undetermined.join('; '));
  return list;
}

export function stateCard() {
  const badge = element('span', {class: 'badge'});
  const list = element('dl', {class: 'facts'});
  const node = element('figure', {class: 'card state'}, element('figcaption', {}, element('h3', {}, 'Tracking'), badge), list);
  return {
    node,
    show(view) {
      badge.textContent = stateText(view);
      badge.classList.toggle('lost', !hasPose(view));
      list.replaceChildren(...rows(view).flatMap(([title, text]) => [element('dt', {}, title), element('dd', {}, text)]));
    },
  };
}
