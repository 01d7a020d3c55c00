// SPDX-License-Identifier: Apache-2.0
// Texts for a view's tracking state, and the events.
import {hasPose} from '../shared/tracking.js';

const kWords = {
  first: 'first view', followed: 'tracking', refined: 'tracking', landmarks: 'tracking by landmarks only',
  ambiguous: 'ambiguous', lost: 'lost',
};

export function trackingText(view) {
  return view.relocalized ? 'relocalized' : kWords[view.tracking] ?? '';
}

// Speed and number of images; empty for a view that was exposed at rest.
export function motionText(view) {
  if (!(view.speed_m_s > 0)) return '';
  return `${view.speed_m_s.toFixed(2)} m/s, ${(view.turn_rad_s * 180 / Math.PI).toFixed(0)} °/s, ${view.images} images`;
}

function eventOf(view, lostAt) {
  if (!hasPose(view)) {
    if (lostAt !== null) return null;
    return view.tracking === 'ambiguous' ? 'several poses fit the view' : 'tracking lost';
  }
  const parts = [];
  if (lostAt !== null) parts.push(`relocalized, lost since view ${lostAt}`);
  if (view.loops) parts.push(`loop closed${view.corrected ? ', map corrected' : ''}`);
  return parts.join('; ') || null;
}

// Returns [{index, lost, text}], oldest first.
export function trackingEvents(views) {
  const events = [];
  let lostAt = null;
  for (const view of views) {
    const text = eventOf(view, lostAt);
    const lost = !hasPose(view);
    if (text) events.push({index: view.index, lost, text});
    lostAt = lost ? lostAt ?? view.index : null;
  }
  return events;
}
