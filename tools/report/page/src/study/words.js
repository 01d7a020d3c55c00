// SPDX-License-Identifier: Apache-2.0
// Names and descriptions of outcomes and causes; the identifiers in the results are defined in
// bench/studies/trial_run.h.
import {data} from '../shared/data.js';
import {short} from '../shared/format.js';

// Name, meaning, and the mark in the scatter plot, drawn around (x, y) with about radius r.
const kOutcomes = {
  success: {
    name: 'success',
    meaning: 'within the study\'s limits',
    mark: (x, y, r) => `M${x - r},${y}a${r},${r} 0 1 0 ${2 * r},0a${r},${r} 0 1 0 ${-2 * r},0`,
  },
  inaccurate: {
    name: 'inaccurate',
    meaning: 'all views have a pose, but at least one motion error exceeds the limits',
    mark: (x, y, r) => `M${x},${y - 1.3 * r}l${1.3 * r},${2.3 * r}h${-2.6 * r}z`,
  },
  confidently_wrong: {
    name: 'confidently wrong',
    meaning: 'off by more than 1 mm and by more than ten reported standard deviations',
    mark: (x, y, r) => `M${x - r},${y - r}l${2 * r},${2 * r}M${x - r},${y + r}l${2 * r},${-2 * r}`,
  },
  lost: {
    name: 'lost',
    meaning: 'a view could not be registered, and was reported as lost',
    mark: (x, y, r) => `M${x - r},${y - r}h${2 * r}v${2 * r}h${-2 * r}z`,
  },
  refused: {
    name: 'refused',
    meaning: 'the scene or the settings are contradictory',
    mark: (x, y, r) => `M${x - 1.2 * r},${y}h${2.4 * r}M${x},${y - 1.2 * r}v${2.4 * r}`,
  },
  crashed: {
    name: 'crashed',
    meaning: 'the process died',
    mark: (x, y, r) => `M${x},${y - 1.4 * r}l${1.4 * r},${1.4 * r}l${-1.4 * r},${1.4 * r}l${-1.4 * r},${-1.4 * r}z`,
  },
  timed_out: {
    name: 'timed out',
    meaning: 'exceeded the study\'s time limit',
    mark: (x, y, r) => `M${x},${y + 1.3 * r}l${1.3 * r},${-2.3 * r}h${-2.6 * r}z`,
  },
};

const kCauses = {
  saturated: 'In at least one view, more than a tenth of the pixels are saturated.',
  too_dark: 'The fringes are so weak (median modulation below 6 grey levels) that they disappear in noise.',
  wrong_fringe_order: 'More than 1 % of the pixels have a wrong fringe order: their depth jumps.',
  little_depth: 'Less than a fifth of the lit pixels have depth.',
  too_little_overlap: 'Two consecutive views overlap by less than a fifth.',
  too_few_landmarks: 'Fewer than 8 keypoints were matched between two views.',
  not_registered: 'Keypoints were matched, but no motion had enough inliers.',
  overconfident_depth: 'The errors of too many depths exceed four of their sigmas.',
  inaccurate_depth: 'The depth exceeds the error limits, or has too many wrong fringe orders.',
  inaccurate_registration: 'The estimated motion exceeds the error limits, and no other cause was found.',
  refused: 'The scene or the settings are contradictory; see the message.',
  crashed: 'The process died.',
  timed_out: 'It exceeded the study\'s time limit.',
};

export const outcomes = Object.keys(kOutcomes);

export function outcomeOf(outcome) {
  return kOutcomes[outcome] ?? {name: outcome.replaceAll('_', ' '), meaning: '', mark: kOutcomes.refused.mark};
}

export function causeName(cause) {
  return cause.replaceAll('_', ' ');
}

export function causeMeaning(cause) {
  return kCauses[cause] ?? '';
}

export function ruleText() {
  const {
    max_translation_mm: shift,
    max_rotation_deg: turn,
    min_valid: valid,
    max_depth_mm: depth,
    max_wrong_order: wrong,
    max_beyond_4_sigma: beyond
  } = data.rule;
  const percent = (share) => `${short(share * 100)} %`;
  const ofDepth = [];
  if (valid > 0) ofDepth.push(`depth at ${percent(valid)} or more of its lit pixels`);
  if (depth < 1e4) ofDepth.push(`a median depth error of at most ${depth} mm`);
  if (wrong < 1) ofDepth.push(`wrong fringe orders at no more than ${percent(wrong)} of them`);
  if (beyond < 1) ofDepth.push(`errors beyond four sigmas at no more than ${percent(beyond)} of them`);
  const also = ofDepth.length > 0 ? `, and every view has ${ofDepth.join(', ')}` : '';
  return `A trial succeeds when every view has a pose, the error of each motion between consecutive views is at most ${
      shift} mm and ${turn}°${also}.`;
}
