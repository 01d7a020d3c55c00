// SPDX-License-Identifier: Apache-2.0
import {byId} from './dom.js';
import {followTheme} from './theme.js';

function fail(error) {
  byId('failure').textContent = `This page could not be drawn completely: ${error.message}`;
  byId('failure').hidden = false;
  console.error(error);
}

// Draws the page by `show` and reports errors in the page.
export async function drawPage(show) {
  try {
    followTheme();
    await show();
  } catch (error) {
    fail(error);
  }
  document.documentElement.dataset.ready = 'true';
}
