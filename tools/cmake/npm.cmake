# SPDX-License-Identifier: Apache-2.0
# Installs the packages of SOURCE/package-lock.json, verified by its hashes, into FOLDER/node_modules and touches
# FOLDER/npm.stamp. Run as a script (-P), it fetches them.
if(CMAKE_SCRIPT_MODE_FILE)
  file(COPY ${SOURCE}/package.json ${SOURCE}/package-lock.json DESTINATION ${FOLDER})
  # No package needs an installation script.
  execute_process(COMMAND ${NPM} ci --ignore-scripts --no-audit --no-fund --loglevel=error
    WORKING_DIRECTORY ${FOLDER} RESULT_VARIABLE failed)
  if(failed)
    message(FATAL_ERROR "error: npm could not fetch the packages of ${SOURCE}/package-lock.json; is the npm registry "
      "reachable? -D FRINGESLAM_REPORT=OFF builds without them")
  endif()
  file(TOUCH ${FOLDER}/npm.stamp)
  return()
endif()

set(FRINGESLAM_NPM_SCRIPT ${CMAKE_CURRENT_LIST_FILE})
function(fringeslam_npm_packages source folder)
  find_program(NPM npm)
  add_custom_command(OUTPUT ${folder}/npm.stamp
    COMMAND ${CMAKE_COMMAND} -D NPM=${NPM} -D SOURCE=${source} -D FOLDER=${folder} -P ${FRINGESLAM_NPM_SCRIPT}
    DEPENDS ${source}/package.json ${source}/package-lock.json
    COMMENT "Fetching npm packages of ${source}"
    VERBATIM)
endfunction()
