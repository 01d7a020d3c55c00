// SPDX-License-Identifier: Apache-2.0
// Explains why a network camera cannot be reached. The most common causes are another subnet and packets that exceed
// the MTU.
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

// Lists the IPv4 interfaces that are up.
std::vector<NetworkInterface> network_interfaces();

// Describes what prevents a camera at that address from sending packets of that many bytes (0: largest that passes),
// and the remedy; empty if nothing does or the address is not IPv4.
std::string network_fault(const std::string& camera_address, int packet_bytes,
                          const std::vector<NetworkInterface>& interfaces);

}  // namespace fringeslam
