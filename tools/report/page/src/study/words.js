// SPDX-License-Identifier: Apache-2.0
// Outcomes and causes as people say them; the words in results are bench/studies/trial_run.h's.
import {data} from '../shared/data.js';

// name, meaning, and the mark in the scatter: drawn around (x, y), about r large.
const kOutcomes = {
  success: {
    name: 'success',
    meaning: 'within the study\'s limits',
    mark: (x, y, r) => `M${x - r},${y}a${r},${r} 0 1 0 ${2 * r},0a${r},${r} 0 1 0 ${-2 * r},0`,
  },
  inaccurate: {
    name: 'inaccurate',
    meaning: 'all views have a pose, but one is off by more than the limits',
    mark: (x, y, r) => `M${x},${y - 1.3 * r}l${1.3 * r},${2.3 * r}h${-2.6 * r}z`,
  },
  confidently_wrong: {
    name: 'confidently wrong',
    meaning: 'off by more than 1 mm and by more than ten of the standard deviations that the program told',
    mark: (x, y, r) => `M${x - r},${y - r}l${2 * r},${2 * r}M${x - r},${y + r}l${2 * r},${-2 * r}`,
  },
  lost: {
    name: 'lost',
    meaning: 'a view could not be placed, and the program said so',
    mark: (x, y, r) => `M${x - r},${y - r}h${2 * r}v${2 * r}h${-2 * r}z`,
  },
  refused: {
    name: 'refused',
    meaning: 'the scene or the settings contradict themselves',
    mark: (x, y, r) => `M${x - 1.2 * r},${y}h${2.4 * r}M${x},${y - 1.2 * r}v${2.4 * r}`,
  },
  crashed: {
    name: 'crashed',
    meaning: 'the process died',
    mark: (x, y, r) => `M${x},${y - 1.4 * r}l${1.4 * r},${1.4 * r}l${-1.4 * r},${1.4 * r}l${-1.4 * r},${-1.4 * r}z`,
  },
  timed_out: {
    name: 'timed out',
    meaning: 'it took longer than the study permits',
    mark: (x, y, r) => `M${x},${y + 1.3 * r}l${1.3 * r},${-2.3 * r}h${-2.6 * r}z`,
  },
};

const kCauses = {
  saturated: 'In some view more than a tenth of the pixels is as bright as the camera can tell.',
  too_dark: 'The fringes are so weak (median modulation below 6 grey levels) that noise hides them.',
  wrong_fringe_order: 'More than 1 % of the pixels were counted to a wrong fringe: their depth jumps.',
  little_depth: 'Less than a fifth of the lit pixels got a depth.',
  too_little_overlap: 'Two views that follow one another share less than a fifth of what they see.',
  too_few_landmarks: 'Fewer than 8 keypoints were matched between two views.',
  not_registered: 'Keypoints were matched, but no motion agreed with enough of them.',
  inaccurate_registration: 'A motion was found and is off by more than the limits; nothing else stood out.',
  refused: 'The scene or the settings contradict themselves, as the message says.',
  crashed: 'The process died.',
  timed_out: 'It took longer than the study permits.',
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
  const {max_translation_mm: shift, max_rotation_deg: turn, min_valid: valid} = data.rule;
  const depth = valid > 0 ? `, and every view has a depth at ${Math.round(valid * 100)} % or more of its lit pixels` : '';
  return `A trial succeeds when every view has a pose, each motion from view to view is off by at most ${shift} mm and ${turn}°${depth}.`;
}
