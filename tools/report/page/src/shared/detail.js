// SPDX-License-Identifier: Apache-2.0
// Level of detail that keeps the picture moving: the share of the points that a frame draws is adapted to the time that the last
// one took, and all of them are drawn once nothing has moved for a moment.

const kFrameMs = 40;  // of a frame while something moves; more than between the frames of slow displays
const kStillMs = 250;
const kLeast = 0.01;
const kGrowth = 1.15;  // from one frame to the next
const kPausedMs = 3000;  // frames this far apart say nothing: the page was hidden

export class Detail {
  // `redraw` asks for a frame.
  constructor(redraw) {
    this.redraw = redraw;
    this.share = 1;
    this.whole = false;  // the next frame draws everything
    this.timer = null;
  }

  // Returns the share to draw in this frame.
  begin() {
    const share = this.whole ? 1 : this.share;
    this.whole = false;
    clearTimeout(this.timer);
    if (share < 1) {
      this.timer = setTimeout(() => {
        this.whole = true;
        this.redraw();
      }, kStillMs);
    }
    return share;
  }

  // Called when a frame that began at `start` with this share has been submitted. The browser delays the next frame until the
  // renderer can take it.
  end(share, start) {
    requestAnimationFrame((next) => {
      const ms = next - start;
      if (ms > kPausedMs) return;
      if (ms > kFrameMs) this.share = Math.max(kLeast, share * kFrameMs / ms);
      else if (ms < kFrameMs / kGrowth) this.share = Math.min(1, Math.max(this.share, share * kGrowth));
    });
  }
}
