// SPDX-License-Identifier: Apache-2.0
// Stays connected to the page's server. Without an answer the delay between attempts grows.
import {Refused} from '../live/server.js';
import {askForToken} from './token.js';

const kLeastMs = 100;  // minimum between answers
const kFirstPatienceMs = 500;
const kMostPatienceMs = 8000;

export const pause = (ms) => new Promise((done) => setTimeout(done, ms));

async function visible() {
  while (document.hidden) {
    await new Promise((done) => document.addEventListener('visibilitychange', done, {once: true}));
  }
}

// Calls `poll`, which asks and uses the answer, again and again while the page is visible; `fail(error)` shows why it
// threw, and is called before the user is asked for a token, too.
export async function keepPolling(poll, fail) {
  let patience = kFirstPatienceMs;
  for (;;) {
    try {
      await poll();
      patience = kFirstPatienceMs;
      await pause(kLeastMs);
      await visible();
    } catch (error) {
      fail(error);
      if (error instanceof Refused && error.status === 401) {
        await askForToken();
        continue;
      }
      await pause(patience * (0.75 + 0.5 * Math.random()));
      patience = Math.min(kMostPatienceMs, 2 * patience);
    }
  }
}

// Describes why there was no answer.
export function reason(error) {
  if (error instanceof Refused && error.status === 401) return 'Token required';
  if (error instanceof Refused && error.status === 503) return 'Too many viewers; retrying';
  if (error instanceof Refused && error.status === 403) return 'Refused: this page is only for the same computer';
  if (error instanceof Refused) return `The server answered with ${error.message}; retrying`;
  return 'No connection; retrying';
}
