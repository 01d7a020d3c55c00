// SPDX-License-Identifier: Apache-2.0
#include "hw/sdl_projector.h"

#include <SDL.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <thread>
#include <vector>

#include "core/types/error.h"
#include "hw/words.h"

namespace fringeslam {

namespace {

using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point start) { return std::chrono::duration<double>(Clock::now() - start).count(); }

[[noreturn]] void fail(const std::string& what) { throw Error("projector: " + what + ": " + SDL_GetError()); }

// Keeps SDL's video subsystem initialised during its lifetime.
class Video {
 public:
  Video() {
    SDL_SetMainReady();
    SDL_SetHint(SDL_HINT_NO_SIGNAL_HANDLERS, "1");
    SDL_SetHint(SDL_HINT_VIDEO_MINIMIZE_ON_FOCUS_LOSS, "0");
    // Wayland's library prints a message of its own where there is no session. The user's environment precedes this.
    if (std::getenv("XDG_RUNTIME_DIR") == nullptr) SDL_SetHint(SDL_HINT_VIDEODRIVER, "x11,kmsdrm");
    if (SDL_InitSubSystem(SDL_INIT_VIDEO) != 0) fail("no desktop to show a window on (is DISPLAY set?)");
    // Without a desktop, SDL may fall back to a driver that draws into invisible memory.
    const std::string driver = SDL_GetCurrentVideoDriver();
    if (driver == "dummy" || driver == "offscreen" || driver == "evdev") {
      SDL_QuitSubSystem(SDL_INIT_VIDEO);
      throw Error("projector: no desktop to show a window on (is DISPLAY set?)");
    }
  }
  ~Video() { SDL_QuitSubSystem(SDL_INIT_VIDEO); }
  Video(const Video&) = delete;
  Video& operator=(const Video&) = delete;
};

struct Destroy {
  void operator()(SDL_Window* window) const { SDL_DestroyWindow(window); }
  void operator()(SDL_Renderer* renderer) const { SDL_DestroyRenderer(renderer); }
  void operator()(SDL_Texture* texture) const { SDL_DestroyTexture(texture); }
};

FoundDisplay display_of(int number) {
  SDL_Rect area{};
  SDL_DisplayMode mode{};
  if (SDL_GetDisplayBounds(number, &area) != 0 || SDL_GetDesktopDisplayMode(number, &mode) != 0)
    fail("display " + std::to_string(number));
  const char* name = SDL_GetDisplayName(number);
  return {number, name ? name : "", {area.x, area.y, area.w, area.h}, static_cast<double>(mode.refresh_rate)};
}

std::vector<FoundDisplay> displays() {
  std::vector<FoundDisplay> found;
  for (int i = 0; i < SDL_GetNumVideoDisplays(); ++i) found.push_back(display_of(i));
  return found;
}

}  // namespace

std::vector<FoundDisplay> find_displays() {
  const Video video;
  return displays();
}

class SdlProjector::Window {
 public:
  Window(int number, cv::Size size) {
    const std::vector<FoundDisplay> found = displays();
    if (number < 0 || number >= static_cast<int>(found.size()))
      throw Error("projector: no display " + std::to_string(number) + "; found " + std::to_string(found.size()) +
                  (found.size() == 1 ? " display, 0" : " displays, from 0") + "; see fringeslam rig list");
    display_ = found[static_cast<size_t>(number)];
    at_ = display_.area.tl();
    if (display_.area.size() != size)
      throw Error("projector: display " + std::to_string(number) + " has " + to_words(display_.area.size()) +
                  ", but the rig's projector has " + to_words(size) + "; set the display to that mode");
    window_.reset(SDL_CreateWindow("FringeSLAM", SDL_WINDOWPOS_CENTERED_DISPLAY(number),
                                   SDL_WINDOWPOS_CENTERED_DISPLAY(number), size.width, size.height,
                                   SDL_WINDOW_FULLSCREEN_DESKTOP | SDL_WINDOW_BORDERLESS | SDL_WINDOW_ALWAYS_ON_TOP));
    if (!window_) fail("window");
    renderer_.reset(SDL_CreateRenderer(window_.get(), -1, SDL_RENDERER_PRESENTVSYNC));
    if (!renderer_) renderer_.reset(SDL_CreateRenderer(window_.get(), -1, SDL_RENDERER_SOFTWARE));
    if (!renderer_) fail("window");
    texture_.reset(SDL_CreateTexture(renderer_.get(), SDL_PIXELFORMAT_ARGB8888, SDL_TEXTUREACCESS_STREAMING, size.width,
                                     size.height));
    if (!texture_) fail("window");
    SDL_ShowCursor(SDL_DISABLE);
    SDL_RaiseWindow(window_.get());
    check();
  }

  cv::Size size() const { return display_.area.size(); }
  double refresh_s() const { return 1 / (display_.refresh_hz > 0 ? display_.refresh_hz : 60); }

  void show(const cv::Mat& image) {
    check();
    upload(image);
    const Clock::time_point start = Clock::now();
    intervals_.clear();
    // Drivers may queue up to two images.
    constexpr int kLeastPresents = 3;
    for (int i = 0; i < kLeastPresents || seconds_since(start) < 2 * refresh_s(); ++i) {
      const Clock::time_point before = Clock::now();
      if (SDL_RenderCopy(renderer_.get(), texture_.get(), nullptr, nullptr) != 0) fail("drawing");
      SDL_RenderPresent(renderer_.get());
      intervals_.push_back(seconds_since(before));
      // If the driver does not wait, waits for one refresh period before the next present.
      if (intervals_.back() < 0.5 * refresh_s())
        std::this_thread::sleep_for(std::chrono::duration<double>(refresh_s()));
    }
    // A round trip to the display server, which replies only after processing all earlier requests.
    SDL_GetGlobalMouseState(nullptr, nullptr);
  }

  double present_interval_s() const {
    std::vector<double> sorted = intervals_;
    if (sorted.empty()) return 0;
    std::sort(sorted.begin(), sorted.end());
    return sorted[sorted.size() / 2];
  }

 private:
  // Detects that a user or the window manager moved, resized or closed the window.
  void check() {
    SDL_PumpEvents();
    SDL_Event event;
    while (SDL_PollEvent(&event)) {
      if (event.type == SDL_QUIT || (event.type == SDL_WINDOWEVENT && event.window.event == SDL_WINDOWEVENT_CLOSE))
        throw Error("projector: the window was closed");
      // SDL's own record of a full-screen window's position is the requested one, not the actual one.
      if (event.type == SDL_WINDOWEVENT && event.window.event == SDL_WINDOWEVENT_MOVED)
        at_ = {event.window.data1, event.window.data2};
    }
    int width = 0, height = 0;
    if (SDL_GetRendererOutputSize(renderer_.get(), &width, &height) != 0) fail("window");
    if (cv::Size(width, height) != size())
      throw Error("projector: the window is " + to_words({width, height}) + ", not the display's " + to_words(size()));
    if (at_ != display_.area.tl())
      throw Error("projector: the window is at (" + std::to_string(at_.x) + ", " + std::to_string(at_.y) +
                  ") of the desktop and does not fill display " + std::to_string(display_.number) +
                  "; the desktop or a user moved it");
  }

  void upload(const cv::Mat& image) {
    const bool grey = image.type() == CV_8UC1;
    if (!grey && image.type() != CV_8UC3) throw Error("projector: an image must have 8 bits and one or three channels");
    void* pixels = nullptr;
    int pitch = 0;
    if (SDL_LockTexture(texture_.get(), nullptr, &pixels, &pitch) != 0) fail("drawing");
    for (int row = 0; row < image.rows; ++row) {
      auto* line = reinterpret_cast<uint32_t*>(static_cast<uint8_t*>(pixels) + row * pitch);
      for (int col = 0; col < image.cols; ++col) {
        if (grey) {
          line[col] = 0xff000000u | 0x010101u * image.at<uchar>(row, col);
        } else {
          const auto& bgr = image.at<cv::Vec3b>(row, col);
          line[col] = 0xff000000u | static_cast<uint32_t>(bgr[2] << 16 | bgr[1] << 8 | bgr[0]);
        }
      }
    }
    SDL_UnlockTexture(texture_.get());
  }

  Video video_;
  FoundDisplay display_;
  cv::Point at_;                                 // window position on the desktop
  std::unique_ptr<SDL_Window, Destroy> window_;  // declared in order of creation; destroyed in reverse
  std::unique_ptr<SDL_Renderer, Destroy> renderer_;
  std::unique_ptr<SDL_Texture, Destroy> texture_;
  std::vector<double> intervals_;
};

SdlProjector::SdlProjector(int display, cv::Size size) : window_(std::make_unique<Window>(display, size)) {}
SdlProjector::~SdlProjector() = default;
cv::Size SdlProjector::size() const { return window_->size(); }
double SdlProjector::refresh_s() const { return window_->refresh_s(); }
double SdlProjector::present_interval_s() const { return window_->present_interval_s(); }

void SdlProjector::show(const cv::Mat& image) {
  if (image.size() != size())
    throw Error("projector: an image of " + to_words(image.size()) + " does not match its " + to_words(size()));
  window_->show(image);
}

}  // namespace fringeslam
