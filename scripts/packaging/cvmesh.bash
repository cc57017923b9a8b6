# SPDX-License-Identifier: AGPL-3.0-or-later
# Completion of cvmesh for bash (zsh: after bashcompinit). Commands and options are read from the
# program's own help, values of options that have a fixed set from there, too.

_cvmesh_help() {
  "${COMP_WORDS[0]}" "$@" --help 2> /dev/null
}

_cvmesh() {
  local word=${COMP_WORDS[COMP_CWORD]} before=${COMP_WORDS[COMP_CWORD - 1]} command=""
  [ "$COMP_CWORD" -gt 1 ] && command=${COMP_WORDS[1]}
  COMPREPLY=()
  if [ -z "$command" ]; then
    # Lines below "Subcommands:" begin with a name.
    local commands
    commands=$(_cvmesh_help | sed -n '/^Subcommands:/,/^[^ S]/s/^  \([a-z-]\{1,\}\) .*/\1/p')
    mapfile -t COMPREPLY < <(compgen -W "$commands --help --version" -- "$word")
    return
  fi
  case $before in
    --space) mapfile -t COMPREPLY < <(compgen -W "input ras lps grid" -- "$word") ;;
    --formats)
      local done="" last=$word
      case $word in *,*) done=${word%,*}, last=${word##*,} ;; esac
      mapfile -t COMPREPLY < <(
        compgen -P "$done" -W "vtu mesh inp msh msh22 feb stl ply vtp" -- "$last")
      ;;
    --out) mapfile -t COMPREPLY < <(compgen -d -- "$word") ;;
    *)
      case $word in
        -*)
          mapfile -t COMPREPLY < <(
            compgen -W "$(_cvmesh_help "$command" | grep -o -e '--[a-z][a-z-]*' | sort -u)" \
              -- "$word")
          ;;
        *) mapfile -t COMPREPLY < <(compgen -f -- "$word") ;;
      esac
      ;;
  esac
}

complete -o filenames -F _cvmesh cvmesh
