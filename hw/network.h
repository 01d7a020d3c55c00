// SPDX-License-Identifier: Apache-2.0
// Whether a network camera can be reached as things are, in words: most cameras that "do not work" are in another
// subnet, or send packets that do not pass.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace fringeslam {

struct NetworkInterface {
  std::string name;
  std::string address, mask;  // IPv4, "192.168.1.7" and "255.255.255.0"
  int mtu = 1500;             // bytes
};

// Those that are up.
std::vector<NetworkInterface> network_interfaces();

// What keeps a camera at that address from sending packets of so many bytes (0: as large as goes through), with what to
// do about it; empty when nothing does, and when the address is none of IPv4.
std::string network_fault(const std::string& camera_address, int packet_bytes,
                          const std::vector<NetworkInterface>& interfaces);

}  // namespace fringeslam
