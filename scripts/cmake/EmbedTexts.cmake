# SPDX-License-Identifier: AGPL-3.0-or-later
# Run by the build: writes a C++ file that defines texts as string views.
#   cmake -DOUTPUT=FILE.cpp -DHEADER=that/declares/them.h -DNAMESPACE=name
#         "-DTEXTS=kName=FILE|kName=FILE|..." -P EmbedTexts.cmake
# No text may hold the end of its raw literal, )embedded".
set(source "// Made by the build from the files it names.\n#include \"${HEADER}\"\n\n")
string(APPEND source "namespace ${NAMESPACE} {\n")
string(REPLACE "|" ";" TEXTS "${TEXTS}")
foreach(text IN LISTS TEXTS)
  string(REGEX MATCH "^([^=]+)=(.+)$" matched "${text}")
  set(name "${CMAKE_MATCH_1}")
  set(file "${CMAKE_MATCH_2}")
  file(READ "${file}" content)
  string(FIND "${content}" ")embedded\"" end)
  if(NOT end EQUAL -1)
    message(FATAL_ERROR "${file} holds the end of a raw literal")
  endif()
  string(APPEND source "\nconst std::string_view ${name} = R\"embedded(${content})embedded\";\n")
endforeach()
string(APPEND source "\n}  // namespace ${NAMESPACE}\n")
file(WRITE "${OUTPUT}" "${source}")
