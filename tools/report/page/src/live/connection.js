// SPDX-License-Identifier: Apache-2.0
// Polls for changes. Without an answer the delay between attempts grows; the server may be a different one when it
// returns, and then sends everything again.
import {byId} from '../shared/dom.js';
import {askForToken} from '../shared/token.js';
import {ask, Refused} from './server.js';
import {store, take} from './store.js';

const kLeastMs = 100;  // minimum between answers
const kFirstPatienceMs = 500;
const kMostPatienceMs = 8000;

const pause = (ms) => new Promise((done) => setTimeout(done, ms));

function say(text, lost) {
  const line = byId('connection');
  if (line.textContent !== text) line.textContent = text;  // announced once by screen readers
  line.classList.toggle('lost', lost);
  document.body.classList.toggle('stale', lost);
}

function reason(error) {
  if (error instanceof Refused && error.status === 503) return 'Too many viewers; retrying';
  if (error instanceof Refused && error.status === 403) return 'Refused: this page is only for the same computer';
  return store.finished ? 'Ended; waiting for the next run' : 'No connection; retrying';
}

async function visible() {
  while (document.hidden) {
    await new Promise((done) => document.addEventListener('visibilitychange', done, {once: true}));
  }
}

export async function stayConnected() {
  let patience = kFirstPatienceMs;
  for (;;) {
    try {
      const answer = await ask(store.run ? `/changes?run=${store.run}&since=${store.sequence}` : '/snapshot');
      take(await answer.json());
      patience = kFirstPatienceMs;
      say(store.finished ? 'Finished' : store.views.length ? 'Connected' : 'Waiting for the first view', false);
      await pause(kLeastMs);
      await visible();
    } catch (error) {
      if (error instanceof Refused && error.status === 401) {
        say('Token required', true);
        await askForToken();
        continue;
      }
      say(reason(error), true);
      await pause(patience * (0.75 + 0.5 * Math.random()));
      patience = Math.min(kMostPatienceMs, 2 * patience);
    }
  }
}
