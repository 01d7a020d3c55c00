// SPDX-License-Identifier: Apache-2.0
#include "hw/network.h"

#include <gmock/gmock.h>

namespace fringeslam {
namespace {

using testing::AllOf;
using testing::HasSubstr;

const std::vector<NetworkInterface> kHome = {{"lo", "127.0.0.1", "255.0.0.0", 65536},
                                             {"eth0", "192.168.1.7", "255.255.255.0", 1500},
                                             {"eth1", "10.1.2.3", "255.255.0.0", 9000}};

TEST(Network, CamerasInReachHaveNoFault) {
  EXPECT_EQ(network_fault("192.168.1.200", 0, kHome), "");
  EXPECT_EQ(network_fault("192.168.1.200", 1500, kHome), "");
  EXPECT_EQ(network_fault("10.1.255.1", 9000, kHome), "");
  EXPECT_EQ(network_fault("127.0.0.1", 0, kHome), "");
  EXPECT_EQ(network_fault("USB3 bus 1", 9000, kHome), "");
}

TEST(Network, AnotherSubnetIsNamed) {
  EXPECT_THAT(network_fault("169.254.10.2", 0, kHome),
              AllOf(HasSubstr("169.254.10.2 is not in any subnet of this computer (eth0 192.168.1.7/24, "
                              "eth1 10.1.2.3/16)"),
                    HasSubstr("change either address")));
  EXPECT_THAT(network_fault("10.2.0.1", 0, kHome), HasSubstr("not in any subnet"));
  EXPECT_THAT(network_fault("10.2.0.1", 0, {}), HasSubstr("no network is up"));
}

TEST(Network, PacketsThatDoNotPassAreNamed) {
  EXPECT_THAT(
      network_fault("192.168.1.200", 9000, kHome),
      HasSubstr("packets of 9000 bytes exceed the MTU of eth0, 1500 bytes; as root, run ip link set eth0 mtu 9000"));
}

TEST(Network, ThisComputerHasALoopback) { EXPECT_EQ(network_fault("127.0.0.1", 1500, network_interfaces()), ""); }

}  // namespace
}  // namespace fringeslam
