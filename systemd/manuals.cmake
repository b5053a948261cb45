# Manual pages and completions, made at the build from the programs' own command lines.
# As a script: cmake -DOUT=FOLDER -DPROGRAMS="PATH;PATH..." -DEMULATOR="COMMAND;WORD..." -P manuals.cmake
if(CMAKE_SCRIPT_MODE_FILE)
  function(write_manual program what file)
    execute_process(COMMAND ${EMULATOR} ${program} --manual ${what} OUTPUT_VARIABLE text COMMAND_ERROR_IS_FATAL ANY)
    file(WRITE ${OUT}/${file} "${text}")
    if(file MATCHES "^man/")
      execute_process(COMMAND gzip -9nf ${OUT}/${file} COMMAND_ERROR_IS_FATAL ANY)
    endif()
  endfunction()
  file(REMOVE_RECURSE ${OUT})
  foreach(program IN LISTS PROGRAMS)
    get_filename_component(name ${program} NAME)
    set(package host)
    if(name MATCHES "-")
      set(package demo)
    endif()
    set(section 1)
    if(name STREQUAL "bendloopd")
      set(section 8)
    endif()
    write_manual(${program} man${section} man/${package}/man${section}/${name}.${section})
    write_manual(${program} bash bash/${package}/${name})
    write_manual(${program} zsh zsh/${package}/_${name})
    execute_process(COMMAND ${EMULATOR} ${program} --manual commands OUTPUT_VARIABLE commands COMMAND_ERROR_IS_FATAL ANY)
    string(REPLACE "\n" ";" commands "${commands}")
    foreach(command IN LISTS commands)
      if(command)
        write_manual(${program} man1:${command} man/${package}/man1/${name}-${command}.1)
      endif()
    endforeach()
  endforeach()
  return()
endif()

set(manuals ${CMAKE_CURRENT_BINARY_DIR}/manuals)
list(TRANSFORM programs REPLACE "(.+)" "$<TARGET_FILE:\\1>" OUTPUT_VARIABLE files)
add_custom_command(OUTPUT ${manuals}.stamp
  COMMAND ${CMAKE_COMMAND} -DOUT=${manuals} "-DPROGRAMS=${files}"
    "-DEMULATOR=${CMAKE_CROSSCOMPILING_EMULATOR}" -P ${CMAKE_CURRENT_LIST_FILE}
  COMMAND ${CMAKE_COMMAND} -E touch ${manuals}.stamp
  DEPENDS ${programs} manuals.cmake VERBATIM)
add_custom_target(bendloop_manuals ALL DEPENDS ${manuals}.stamp)
foreach(package IN ITEMS host demo)
  install(DIRECTORY ${manuals}/man/${package}/ DESTINATION ${CMAKE_INSTALL_MANDIR} COMPONENT ${package})
  install(DIRECTORY ${manuals}/bash/${package}/
    DESTINATION ${CMAKE_INSTALL_DATADIR}/bash-completion/completions COMPONENT ${package})
  # Where Debian's zsh looks for what packages bring.
  install(DIRECTORY ${manuals}/zsh/${package}/
    DESTINATION ${CMAKE_INSTALL_DATADIR}/zsh/vendor-completions COMPONENT ${package})
endforeach()
