// SPDX-License-Identifier: Apache-2.0
import {data} from '../shared/data.js';
import {drawPage} from '../shared/page.js';
import {showHeader} from './header.js';
import {showLeftOut} from './left_out.js';
import {showPictures} from './pictures.js';
import {showPlots} from './plots.js';
import {showScene} from './scene.js';
import {showScrubber} from './scrubber.js';
import {showTables} from './tables.js';
import {showWarmThings} from './warm_things.js';

drawPage(async () => {
  showHeader();
  showLeftOut();
  if (data.views.length > 0) {
    showScrubber();
    showPictures();
    showWarmThings();
    showTables();
    showPlots();
  }
  await showScene();
});
