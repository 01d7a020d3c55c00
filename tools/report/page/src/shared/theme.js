// SPDX-License-Identifier: Apache-2.0
// Light or dark theme: the system's preference until the button is used.
import {byId} from './dom.js';

const kKey = 'fringeslam-theme';
const listeners = [];
let dark = false;

export const theme = {
  get dark() {
    return dark;
  },
  // The listener is called immediately and after each change.
  on(listener) {
    listeners.push(listener);
    listener(dark);
  },
};

// Storage may be unavailable to pages opened from files.
function remembered() {
  try {
    return localStorage.getItem(kKey);
  } catch {
    return null;
  }
}

function remember(choice) {
  try {
    localStorage.setItem(kKey, choice);
  } catch {
    // Not stored: the next time the page follows the system's preference.
  }
}

export function followTheme() {
  const system = matchMedia('(prefers-color-scheme: dark)');
  let chosen = remembered();
  const apply = () => {
    dark = chosen ? chosen === 'dark' : system.matches;
    document.documentElement.dataset.theme = dark ? 'dark' : 'light';
    byId('theme').setAttribute('aria-pressed', String(dark));
    for (const listener of listeners) listener(dark);
  };
  system.addEventListener('change', apply);
  byId('theme').addEventListener('click', () => {
    chosen = dark ? 'light' : 'dark';
    remember(chosen);
    apply();
  });
  apply();
}
