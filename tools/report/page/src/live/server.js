// SPDX-License-Identifier: Apache-2.0
// Requests to the page's server, with the token if it requires one.
const kKey = 'fringeslam-token';
const kPatienceMs = 15000;

let token = '';

// The token from the printed address (…/#token=…), from which it is removed immediately, or the one stored for this
// tab.
export function readToken() {
  const given = new URLSearchParams(location.hash.slice(1)).get('token');
  if (given) {
    history.replaceState(null, '', location.pathname);
    useToken(given);
  } else {
    token = sessionStorage.getItem(kKey) ?? '';
  }
}

export function useToken(text) {
  token = text;
  sessionStorage.setItem(kKey, text);
}

export class Refused extends Error {
  constructor(status) {
    super(`status ${status}`);
    this.status = status;
  }
}

// Returns the answer, or null if the requested data is gone (204). Throws when `signal` aborts, by default on timeout.
export function ask(path, signal = AbortSignal.timeout(kPatienceMs)) {
  return send('GET', path, signal);
}

// Gives the program an order.
export function order(path) {
  return send('POST', path, AbortSignal.timeout(kPatienceMs));
}

// Sends a request, with a file as its body if there is one.
export async function send(method, path, signal, body) {
  const answer = await fetch(path, {
    method,
    body,
    cache: 'no-store',
    headers: token ? {Authorization: `Bearer ${token}`} : {},
    signal,
  });
  if (!answer.ok) throw new Refused(answer.status);
  return answer.status === 204 ? null : answer;
}
