// SPDX-License-Identifier: Apache-2.0
import {drawPage} from '../shared/page.js';
import {showCandidates} from './candidates.js';
import {stayConnected} from './connection.js';
import {showHeader} from './header.js';
import {showHistory} from './history.js';
import {showPictures} from './pictures.js';
import {showScene} from './scene.js';
import {readToken} from './server.js';

drawPage(() => {
  readToken();
  showHeader();
  showHistory();
  showCandidates();
  showPictures();
  showScene();
  stayConnected();
});
