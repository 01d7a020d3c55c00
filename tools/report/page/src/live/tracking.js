// SPDX-License-Identifier: Apache-2.0
// How a view was tracked, in words; and the views at which that changed.
const kWords = {
  first: 'first view', followed: 'tracking', refined: 'tracking', landmarks: 'tracking by landmarks alone', lost: 'lost',
};

export function trackingText(view) {
  return view.found_again ? 'found again' : kWords[view.tracking] ?? '';
}

// [{index, lost, text}], the oldest first.
export function trackingEvents(views) {
  const events = [];
  let lostAt = null;
  for (const view of views) {
    if (view.tracking === 'lost' && lostAt === null) {
      lostAt = view.index;
      events.push({index: view.index, lost: true, text: 'tracking lost'});
    } else if (view.tracking !== 'lost' && lostAt !== null) {
      events.push({index: view.index, lost: false, text: `found again, lost since view ${lostAt}`});
      lostAt = null;
    }
  }
  return events;
}
