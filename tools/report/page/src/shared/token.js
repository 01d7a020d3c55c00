// SPDX-License-Identifier: Apache-2.0
// The form in which the user of a page of another host enters its token.
import {useToken} from '../live/server.js';
import {byId} from './dom.js';

// Waits until the user has entered a token.
export function askForToken() {
  const form = byId('token-form');
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
