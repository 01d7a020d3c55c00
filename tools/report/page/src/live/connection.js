// SPDX-License-Identifier: Apache-2.0
// Asks for what changed, again and again. Without an answer it waits longer from time to time; the server may be another
// one when it is back, which then tells everything anew.
import {byId} from '../shared/dom.js';
import {ask, Refused, useToken} from './server.js';
import {store, take} from './store.js';

const kLeastMs = 100;  // from answer to answer
const kFirstPatienceMs = 500;
const kMostPatienceMs = 8000;

const pause = (ms) => new Promise((done) => setTimeout(done, ms));

function say(text, lost) {
  const line = byId('connection');
  if (line.textContent !== text) line.textContent = text;  // said once by screen readers
  line.classList.toggle('lost', lost);
  document.body.classList.toggle('stale', lost);
}

function reason(error) {
  if (error instanceof Refused && error.status === 503) return 'Too many viewers; trying again';
  if (error instanceof Refused && error.status === 403) return 'Refused: this page is for the computer itself';
  return store.finished ? 'Ended; waiting for the next' : 'No connection; trying again';
}

// Until someone typed it.
function askForToken() {
  const form = byId('token-form');
  say('A token is asked for', true);
  form.hidden = false;
  byId('token').focus();
  return new Promise((done) => {
    form.onsubmit = (event) => {
      event.preventDefault();
      useToken(byId('token').value.trim());
      form.hidden = true;
      done();
    };
  });
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
        await askForToken();
        continue;
      }
      say(reason(error), true);
      await pause(patience * (0.75 + 0.5 * Math.random()));
      patience = Math.min(kMostPatienceMs, 2 * patience);
    }
  }
}
