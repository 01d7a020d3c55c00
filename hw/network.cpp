// SPDX-License-Identifier: Apache-2.0
#include "hw/network.h"

#include <arpa/inet.h>
#include <ifaddrs.h>
#include <net/if.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <cstring>
#include <memory>
#include <optional>

namespace fringeslam {

namespace {

std::optional<uint32_t> number_of(const std::string& address) {
  in_addr number{};
  if (inet_pton(AF_INET, address.c_str(), &number) != 1) return std::nullopt;
  return ntohl(number.s_addr);
}

std::string text_of(const sockaddr* address) {
  char text[INET_ADDRSTRLEN] = "";
  inet_ntop(AF_INET, &reinterpret_cast<const sockaddr_in*>(address)->sin_addr, text, sizeof text);
  return text;
}

int mtu_of(const char* name) {
  const int any = socket(AF_INET, SOCK_DGRAM, 0);
  if (any < 0) return 1500;
  ifreq request{};
  std::strncpy(request.ifr_name, name, IFNAMSIZ - 1);
  const bool known = ioctl(any, SIOCGIFMTU, &request) == 0;
  close(any);
  return known ? request.ifr_mtu : 1500;
}

// Address with prefix length, e.g. "192.168.1.7/24".
std::string with_length(const NetworkInterface& interface) {
  int bits = 0;
  for (uint32_t mask = number_of(interface.mask).value_or(0); mask; mask <<= 1) ++bits;
  return interface.address + "/" + std::to_string(bits);
}

bool reaches(const NetworkInterface& interface, uint32_t camera) {
  const auto own = number_of(interface.address), mask = number_of(interface.mask);
  return own && mask && (camera & *mask) == (*own & *mask);
}

}  // namespace

std::vector<NetworkInterface> network_interfaces() {
  ifaddrs* first = nullptr;
  if (getifaddrs(&first) != 0) return {};
  const std::unique_ptr<ifaddrs, decltype(&freeifaddrs)> all(first, freeifaddrs);
  std::vector<NetworkInterface> interfaces;
  for (const ifaddrs* i = first; i; i = i->ifa_next) {
    if (!i->ifa_addr || !i->ifa_netmask || i->ifa_addr->sa_family != AF_INET || !(i->ifa_flags & IFF_UP)) continue;
    interfaces.push_back({i->ifa_name, text_of(i->ifa_addr), text_of(i->ifa_netmask), mtu_of(i->ifa_name)});
  }
  return interfaces;
}

std::string network_fault(const std::string& camera_address, int packet_bytes,
                          const std::vector<NetworkInterface>& interfaces) {
  const auto camera = number_of(camera_address);
  if (!camera) return "";
  std::string subnets;
  for (const NetworkInterface& interface : interfaces) {
    if (reaches(interface, *camera)) {
      if (packet_bytes <= interface.mtu) return "";
      return "packets of " + std::to_string(packet_bytes) + " bytes exceed the MTU of " + interface.name + ", " +
             std::to_string(interface.mtu) + " bytes; as root, run ip link set " + interface.name + " mtu " +
             std::to_string(packet_bytes) + ", or reduce hardware.camera.packet_bytes";
    }
    if (!interface.address.starts_with("127."))
      subnets += (subnets.empty() ? "" : ", ") + interface.name + " " + with_length(interface);
  }
  return "its address " + camera_address + " is not in any subnet of this computer (" +
         (subnets.empty() ? "no network is up" : subnets) + "); change either address so that both are in one subnet";
}

}  // namespace fringeslam
