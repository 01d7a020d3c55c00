// SPDX-License-Identifier: Apache-2.0
// The chosen trial and the highlighted failures; displays register as listeners.
import {data} from '../shared/data.js';
import {amount} from '../shared/format.js';

const listeners = [];
const {trials} = data;
const places = new Map(trials.trial.map((trial, place) => [trial, place]));
// Initially the worst trial.
const state = {place: places.get(data.worst[0]?.trial) ?? (trials.trial.length ? 0 : -1), cause: ''};

export const store = {
  // An index into the columns of data.trials; −1 if none.
  get place() {
    return state.place;
  },
  // A cause, 'failures', or '' for all trials.
  get cause() {
    return state.cause;
  },
  choose(place) {
    if (trials.trial.length === 0) return;
    state.place = Math.max(0, Math.min(trials.trial.length - 1, place));
    tell();
  },
  pickOut(cause) {
    state.cause = cause;
    tell();
  },
  // The listener is called immediately and after each change.
  on(listener) {
    listeners.push(listener);
    listener(state);
  },
};

function tell() {
  for (const listener of listeners) listener(state);
}

export function placeOf(trial) {
  return places.get(trial);
}

// Returns a trial as one object.
export function trialAt(place) {
  return {
    trial: trials.trial[place],
    outcome: trials.outcomes[trials.outcome[place]],
    cause: trials.causes[trials.cause[place]] ?? '',
    translation_mm: trials.translation_mm[place],
    rotation_deg: trials.rotation_deg[place],
    values: trials.values.map((column) => column[place]),
  };
}

export function isPickedOut({outcome, cause}) {
  if (!store.cause) return true;
  return store.cause === 'failures' ? outcome !== 'success' : cause === store.cause;
}

export function valueText(p, value) {
  const {values} = data.parameters[p];
  if (values.length) return values[value] ?? '–';
  return amount(value);
}
