// SPDX-License-Identifier: Apache-2.0
// Polls for changes. The server may be a different one when it returns after an interruption, and then sends everything
// again.
import {byId} from '../shared/dom.js';
import {keepPolling, reason} from '../shared/polling.js';
import {ask, Refused} from './server.js';
import {store, take} from './store.js';

function say(text, lost) {
  const line = byId('connection');
  if (line.textContent !== text) line.textContent = text;  // announced once by screen readers
  line.classList.toggle('lost', lost);
  document.body.classList.toggle('stale', lost);
}

export function stayConnected() {
  return keepPolling(async () => {
    const answer = await ask(store.run ? `/changes?run=${store.run}&since=${store.sequence}` : '/snapshot');
    take(await answer.json());
    say(store.finished ? 'Finished' : store.views.length ? 'Connected' : 'Waiting for the first view', false);
  }, (error) => say(store.finished && !(error instanceof Refused) ? 'Ended; waiting for the next run' : reason(error), true));
}
