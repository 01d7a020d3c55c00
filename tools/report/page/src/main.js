// SPDX-License-Identifier: Apache-2.0
import {data} from './data.js';
import {byId} from './dom.js';
import {showHeader} from './header.js';
import {showLeftOut} from './left_out.js';
import {showPictures} from './pictures.js';
import {showPlots} from './plots.js';
import {showScene} from './scene.js';
import {showScrubber} from './scrubber.js';
import {showTables} from './tables.js';
import {followTheme} from './theme.js';

function fail(error) {
  byId('failure').textContent = `This page could not be drawn in full: ${error.message}`;
  byId('failure').hidden = false;
  console.error(error);
}

async function show() {
  followTheme();
  showHeader();
  showLeftOut();
  if (data.views.length > 0) {
    showScrubber();
    showPictures();
    showTables();
    showPlots();
  }
  await showScene();
}

show().catch(fail).finally(() => (document.documentElement.dataset.ready = 'true'));
