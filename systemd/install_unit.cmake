# At installing: the unit, with the places where the programs and the configuration went to.
# bindir and sysconfdir are absolute, or below the prefix.
foreach(place IN ITEMS bindir sysconfdir)
  if(NOT IS_ABSOLUTE "${${place}}")
    set(${place} "${CMAKE_INSTALL_PREFIX}/${${place}}")
  endif()
endforeach()
file(READ ${source_dir}/bendloopd.service unit)
string(REPLACE "/usr/bin/bendloop" "${bindir}/bendloop" unit "${unit}")
string(REPLACE "/etc/bendloop/" "${sysconfdir}/bendloop/" unit "${unit}")
file(WRITE ${binary_dir}/bendloopd.service "${unit}")
file(INSTALL ${binary_dir}/bendloopd.service DESTINATION ${CMAKE_INSTALL_PREFIX}/lib/systemd/system)
