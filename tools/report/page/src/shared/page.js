// SPDX-License-Identifier: Apache-2.0
import {byId} from './dom.js';
import {followTheme} from './theme.js';

function fail(error) {
  byId('failure').textContent = `This page could not be drawn in full: ${error.message}`;
  byId('failure').hidden = false;
  console.error(error);
}

// Draws the page by `show`; what goes wrong is said in it.
export async function drawPage(show) {
  try {
    followTheme();
    await show();
  } catch (error) {
    fail(error);
  }
  document.documentElement.dataset.ready = 'true';
}
