// SPDX-License-Identifier: Apache-2.0
// True unless the view was lost or several poses explain it equally well.
export function hasPose(view) {
  return view.tracking !== 'lost' && view.tracking !== 'ambiguous';
}
