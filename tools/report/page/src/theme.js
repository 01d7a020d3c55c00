// SPDX-License-Identifier: Apache-2.0
// Light or dark: what the system prefers, until the button says otherwise.
import {byId} from './dom.js';
import {store} from './store.js';

const kKey = 'fringeslam-theme';

// Storage may be forbidden to pages from files.
function remembered() {
  try {
    return localStorage.getItem(kKey);
  } catch {
    return null;
  }
}

function remember(theme) {
  try {
    localStorage.setItem(kKey, theme);
  } catch {
    // The page then follows the system the next time.
  }
}

export function followTheme() {
  const system = matchMedia('(prefers-color-scheme: dark)');
  let chosen = remembered();
  const apply = () => {
    const dark = chosen ? chosen === 'dark' : system.matches;
    document.documentElement.dataset.theme = dark ? 'dark' : 'light';
    byId('theme').setAttribute('aria-pressed', String(dark));
    store.setDark(dark);
  };
  system.addEventListener('change', apply);
  byId('theme').addEventListener('click', () => {
    chosen = store.dark ? 'light' : 'dark';
    remember(chosen);
    apply();
  });
  apply();
}
