// SPDX-License-Identifier: Apache-2.0
// How a view was tracked, in words; and the views at which something happened.
const kWords = {
  first: 'first view', followed: 'tracking', refined: 'tracking', landmarks: 'tracking by landmarks alone', lost: 'lost',
};

export function trackingText(view) {
  return view.found_again ? 'found again' : kWords[view.tracking] ?? '';
}

function eventOf(view, lostAt) {
  if (view.tracking === 'lost') return lostAt === null ? 'tracking lost' : null;
  const parts = [];
  if (lostAt !== null) parts.push(`found again, lost since view ${lostAt}`);
  if (view.loops) parts.push(`loop closed${view.corrected ? ', map corrected' : ''}`);
  return parts.join('; ') || null;
}

// [{index, lost, text}], the oldest first.
export function trackingEvents(views) {
  const events = [];
  let lostAt = null;
  for (const view of views) {
    const text = eventOf(view, lostAt);
    const lost = view.tracking === 'lost';
    if (text) events.push({index: view.index, lost, text});
    lostAt = lost ? lostAt ?? view.index : null;
  }
  return events;
}
