# SPDX-License-Identifier: Apache-2.0
# ROS bags: finds librosbag-storage and the headers of the standard messages; sets rosbag_FOUND and the target
# fringeslam_rosbag_storage. Debian's own CMake and pkg-config files of these packages do not agree on where pluginlib's
# headers are.
set(rosbag_FOUND ON)
set(rosbag_missing "")
add_library(fringeslam_rosbag_storage INTERFACE)
foreach(header rosbag/bag.h ros/serialization.h console_bridge/console.h pluginlib/class_loader.hpp
        class_loader/class_loader.hpp rcutils/macros.h rcpputils/shared_library.hpp ament_index_cpp/get_package_prefix.hpp std_msgs/String.h
        sensor_msgs/PointCloud2.h nav_msgs/Path.h tf2_msgs/TFMessage.h)
  get_filename_component(folder ${header} DIRECTORY)
  find_path(rosbag_${folder}_INCLUDE ${header} PATH_SUFFIXES ${folder})
  mark_as_advanced(rosbag_${folder}_INCLUDE)
  if(rosbag_${folder}_INCLUDE)
    target_include_directories(fringeslam_rosbag_storage SYSTEM INTERFACE ${rosbag_${folder}_INCLUDE})
  else()
    list(APPEND rosbag_missing ${header})
  endif()
endforeach()
foreach(library rosbag_storage roscpp_serialization rostime cpp_common console_bridge)
  find_library(rosbag_${library}_LIBRARY ${library})
  mark_as_advanced(rosbag_${library}_LIBRARY)
  if(rosbag_${library}_LIBRARY)
    target_link_libraries(fringeslam_rosbag_storage INTERFACE ${rosbag_${library}_LIBRARY})
  else()
    list(APPEND rosbag_missing lib${library})
  endif()
endforeach()
if(rosbag_missing)
  set(rosbag_FOUND OFF)
  list(JOIN rosbag_missing ", " rosbag_missing)
  message(STATUS "ROS bags are left out: no ${rosbag_missing} (tools/setup --ros installs them)")
endif()
