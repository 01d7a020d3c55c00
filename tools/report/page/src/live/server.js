// SPDX-License-Identifier: Apache-2.0
// Requests to the server that the page is from, with the token where it asks for one.
const kKey = 'fringeslam-token';
const kPatienceMs = 15000;

let token = '';

// From the address that was printed (…/#token=…), out of which it is taken at once, or as it was in this tab before.
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

// The answer; null when what was asked for is no longer there (204). Throws when there is none in time.
export async function ask(path) {
  const answer = await fetch(path, {
    cache: 'no-store',
    headers: token ? {Authorization: `Bearer ${token}`} : {},
    signal: AbortSignal.timeout(kPatienceMs),
  });
  if (!answer.ok) throw new Refused(answer.status);
  return answer.status === 204 ? null : answer;
}
