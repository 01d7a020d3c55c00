// SPDX-License-Identifier: Apache-2.0
import {drawPage} from '../shared/page.js';
import {showCauses} from './causes.js';
import {showEnvelope} from './envelope.js';
import {showErrors} from './errors.js';
import {showHeader} from './header.js';
import {showParameters} from './parameters.js';
import {showScatter} from './scatter.js';
import {showSensitivity} from './sensitivity.js';
import {showTables} from './tables.js';
import {showWorst} from './worst.js';

drawPage(async () => {
  showHeader();
  showParameters();
  showCauses();
  showErrors();
  showSensitivity();
  showEnvelope();
  showScatter();
  showTables();
  await showWorst();
});
