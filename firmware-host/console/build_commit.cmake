# Writes the header that names the commit and how it is built; run at each build, and written anew
# only when that changed. Sources without git say it by -DBENDLOOP_COMMIT=....
set(commit "${BENDLOOP_COMMIT}")
if(NOT commit)
  execute_process(
    COMMAND git -c safe.directory=${SOURCE_DIR} -C ${SOURCE_DIR}
      describe --always --dirty=+ --abbrev=12 --exclude=*
    OUTPUT_VARIABLE commit ERROR_QUIET OUTPUT_STRIP_TRAILING_WHITESPACE)
endif()
if(NOT commit)
  set(commit "unknown")
endif()
set(text "#pragma once\n#define BENDLOOP_COMMIT \"${commit}\"\n")
set(before "")
if(EXISTS ${HEADER})
  file(READ ${HEADER} before)
endif()
if(NOT before STREQUAL text)
  file(WRITE ${HEADER} "${text}")
endif()
