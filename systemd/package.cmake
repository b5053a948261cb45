# `cpack -G DEB` in the build folder: bendloop_VERSION_ARCH.deb, bendloop-demo_VERSION_ARCH.deb and, where
# OpenCASCADE is, bendloop-cad_VERSION_ARCH.deb.
set(BENDLOOP_PACKAGER "bendloop maintainers <maintainers@bendloop.invalid>" CACHE STRING
  "Maintainer of the Debian packages: NAME <ADDRESS>")
set(generated ${CMAKE_CURRENT_BINARY_DIR}/debian)

# The packages' changelog has the version, and the commit's time; what changed is in CHANGELOG.md.
execute_process(COMMAND git -c safe.directory=${CMAKE_SOURCE_DIR} -C ${CMAKE_SOURCE_DIR} log -1 --format=%cD
  OUTPUT_VARIABLE date ERROR_QUIET OUTPUT_STRIP_TRAILING_WHITESPACE)
if(NOT date)
  string(TIMESTAMP date "%a, %d %b %Y %H:%M:%S +0000" UTC)
endif()
configure_file(debian/changelog.in ${generated}/changelog @ONLY)
execute_process(COMMAND gzip -9nc ${generated}/changelog OUTPUT_FILE ${generated}/changelog.gz)

# What is edited on the machine, for dpkg: one absolute name a line.
set(conffiles "")
foreach(folder IN LISTS edited)
  file(GLOB names CONFIGURE_DEPENDS RELATIVE ${CMAKE_SOURCE_DIR}/config ${CMAKE_SOURCE_DIR}/config/${folder}/*)
  foreach(name IN LISTS names)
    string(APPEND conffiles "/etc/bendloop/${name}\n")
  endforeach()
endforeach()
file(CONFIGURE OUTPUT ${generated}/conffiles CONTENT "${conffiles}")

# Only in the packages: what Debian wants there.
set(packages bendloop bendloop-demo)
if(BENDLOOP_HAS_OCCT)
  list(APPEND packages bendloop-cad)
endif()
foreach(package IN LISTS packages)
  install(FILES ${generated}/changelog.gz debian/copyright DESTINATION share/doc/${package}
    COMPONENT ${package}-debian EXCLUDE_FROM_ALL)
endforeach()
install(FILES debian/bendloop.lintian-overrides DESTINATION share/lintian/overrides RENAME bendloop
  COMPONENT bendloop-debian EXCLUDE_FROM_ALL)

# cpack packs what was built; it does not build all, tests included, before.
set(CMAKE_SKIP_INSTALL_ALL_DEPENDENCY ON PARENT_SCOPE)
set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME bendloop)
set(CPACK_PACKAGE_VERSION ${PROJECT_VERSION})
set(CPACK_PACKAGE_CONTACT "${BENDLOOP_PACKAGER}")
set(CPACK_PACKAGE_DIRECTORY ${CMAKE_BINARY_DIR}/packages)
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_INSTALL_PREFIX /usr)
set(CPACK_SET_DESTDIR ON)  # /etc/bendloop is absolute
set(CPACK_STRIP_FILES ON)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_COMPONENTS_GROUPING ONE_PER_GROUP)
set(CPACK_COMPONENTS_ALL host bendloop-debian demo bendloop-demo-debian)
foreach(component IN ITEMS host bendloop-debian)
  string(TOUPPER ${component} name)
  set(CPACK_COMPONENT_${name}_GROUP appliance)
endforeach()
foreach(component IN ITEMS demo bendloop-demo-debian)
  string(TOUPPER ${component} name)
  set(CPACK_COMPONENT_${name}_GROUP simulators)
endforeach()
if(BENDLOOP_HAS_OCCT)
  list(APPEND CPACK_COMPONENTS_ALL cad bendloop-cad-debian)
  set(CPACK_COMPONENT_CAD_GROUP cadreader)
  set(CPACK_COMPONENT_BENDLOOP-CAD-DEBIAN_GROUP cadreader)
endif()
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_PRIORITY optional)
set(CPACK_DEBIAN_PACKAGE_SECTION electronics)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)

# For another processor: dpkg-shlibdeps looks for its libraries, and for their packages, where they lie.
if(CMAKE_CROSSCOMPILING)
  set(CPACK_DEBIAN_PACKAGE_ARCHITECTURE arm64)
  set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS_PRIVATE_DIRS
    ${CMAKE_SYSROOT}/usr/lib/aarch64-linux-gnu ${CMAKE_SYSROOT}/lib/aarch64-linux-gnu)
  set(CPACK_PROJECT_CONFIG_FILE ${generated}/cross.cmake)
  file(CONFIGURE OUTPUT ${generated}/cross.cmake CONTENT
    "set(ENV{DEB_HOST_ARCH} arm64)\nset(ENV{DPKG_ADMINDIR} \"${CMAKE_SYSROOT}/var/lib/dpkg\")\n")
endif()

set(CPACK_DEBIAN_APPLIANCE_PACKAGE_NAME bendloop)
# systemd-sysusers and systemd-tmpfiles make user and folders; the daemon runs without systemd, too.
set(CPACK_DEBIAN_APPLIANCE_PACKAGE_DEPENDS
  "systemd | systemd-standalone-sysusers, systemd | systemd-standalone-tmpfiles")
set(CPACK_DEBIAN_APPLIANCE_PACKAGE_RECOMMENDS "udev")
set(CPACK_DEBIAN_APPLIANCE_PACKAGE_SUGGESTS "bendloop-cad, bendloop-demo")
set(CPACK_DEBIAN_APPLIANCE_DESCRIPTION
"tube inspection and correction beside a bending cell
A daemon reads laser-line profiles of a bent tube from a scanner, measures
its lengths, rotations and angles while the scan still runs, compares them
with the nominal, and sends the corrected program to the bending machine
over Modbus or CAN. When it is in doubt it refuses and writes nothing.
.
Nothing is started by installing: a cell is configured first, in
/etc/bendloop/cell.toml.")
set(scripts ${CMAKE_CURRENT_SOURCE_DIR}/debian)
set(CPACK_DEBIAN_APPLIANCE_PACKAGE_CONTROL_EXTRA
  "${scripts}/postinst;${scripts}/prerm;${scripts}/postrm;${generated}/conffiles")

set(CPACK_DEBIAN_SIMULATORS_PACKAGE_NAME bendloop-demo)
set(CPACK_DEBIAN_SIMULATORS_PACKAGE_DEPENDS "bendloop (= ${PROJECT_VERSION})")
set(CPACK_DEBIAN_SIMULATORS_DESCRIPTION
"simulated bender and scanner for bendloop
A bender (Modbus TCP and RTU, CANopen, ISO-TP) and a scanner (TCP, or a real
USB device on a device port) to try bendloop on, without a machine. They
misbehave on demand. The command 'bendloop demo' bends, scans and corrects
three parts with them.")

# Neither daemon nor demo needs it, and OpenCASCADE takes more room than all of bendloop.
set(CPACK_DEBIAN_CADREADER_PACKAGE_NAME bendloop-cad)
set(CPACK_DEBIAN_CADREADER_PACKAGE_RECOMMENDS "bendloop")
set(CPACK_DEBIAN_CADREADER_DESCRIPTION
"CAD files for bendloop: STEP and IGES
The commands 'bendloop nominal', which makes a part file from a tube's STEP
or IGES file, and 'bendloop export', which writes a measured tube as STEP,
run this program. It reads and writes with OpenCASCADE, in a process of its
own with limits of time and memory.")
include(CPack)
