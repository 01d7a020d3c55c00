# SPDX-License-Identifier: Apache-2.0
# Installs BUILD_FOLDER into a temporary prefix, then configures, builds and runs this folder's project against it.
cmake_minimum_required(VERSION 3.25)
set(prefix ${WORK_FOLDER}/prefix)
file(REMOVE_RECURSE ${WORK_FOLDER})

function(must_run)
  execute_process(COMMAND ${ARGN} RESULT_VARIABLE result OUTPUT_VARIABLE output ERROR_VARIABLE output)
  if(NOT result EQUAL 0)
    list(JOIN ARGN " " command)
    message(FATAL_ERROR "${command}: ${result}\n${output}")
  endif()
endfunction()

must_run(${CMAKE_COMMAND} --install ${BUILD_FOLDER} --prefix ${prefix} --config ${CONFIG})

# The package must also work on machines without the source and build folders.
file(GLOB_RECURSE package_files ${prefix}/*.cmake)
if(NOT package_files)
  message(FATAL_ERROR "no CMake package was installed into ${prefix}")
endif()
foreach(file ${package_files})
  file(READ ${file} text)
  string(FIND "${text}" "${SOURCE_FOLDER}" place)
  if(NOT place EQUAL -1)
    message(FATAL_ERROR "${file} refers to the source folder")
  endif()
endforeach()

# The examples see the installed package only: they are copied out of the source tree.
file(COPY ${SOURCE_FOLDER}/examples DESTINATION ${WORK_FOLDER})
must_run(${CMAKE_COMMAND} -S ${WORK_FOLDER}/examples -B ${WORK_FOLDER}/build -G ${GENERATOR}
  -D CMAKE_PREFIX_PATH=${prefix} -D CMAKE_BUILD_TYPE=${CONFIG} -D CMAKE_CXX_COMPILER=${CXX}
  -D CMAKE_CXX_FLAGS=${CXX_FLAGS} -D CMAKE_FIND_USE_PACKAGE_REGISTRY=OFF)
must_run(${CMAKE_COMMAND} --build ${WORK_FOLDER}/build --config ${CONFIG})
set(scenes ${prefix}/share/fringeslam/scenes)
must_run(${WORK_FOLDER}/build/render_map_score ${scenes}/boxes_and_foam/scene.yaml)
must_run(${WORK_FOLDER}/build/own_decoder ${scenes}/boxes_and_foam/scene.yaml)
must_run(${WORK_FOLDER}/build/own_slam ${scenes}/rubble_pile/scene.yaml)
must_run(${WORK_FOLDER}/build/own_rig)
must_run(${WORK_FOLDER}/build/motion_compensation ${scenes}/loop/scene.yaml ${WORK_FOLDER}/moving_depth.png)
must_run(${prefix}/bin/fringeslam --version)
