#!/bin/sh
# Builds a participant's Dockerfile and exports what comes of it, for `mdrive-sumo admin environment import`:
#   docker/build-agent.sh SUBMISSION IMAGE.tar [option of buildah bud ...]
# SUBMISSION is the unpacked archive. This runs a stranger's commands with a network and outside every box: read the file
# first, and see docs/docker.md, "A participant's Dockerfile", for the machine to do it on. Nothing calls this script.
set -eu

refuse() {
  echo "build-agent: $1" >&2
  exit 2
}

[ $# -ge 2 ] || refuse "expected a folder and a new file, see the head of this script"
submission=$1 image=$2
shift 2
[ -f "$submission/Dockerfile" ] || refuse "$submission: expected a folder with a Dockerfile, found none"
[ ! -e "$image" ] || refuse "$image: expected a new file, found one that exists"
command -v buildah >/dev/null || refuse "expected buildah, found none: apt-get install buildah"
if command -v mdrive-sumo >/dev/null; then
  refuse "found mdrive-sumo installed: a machine that evaluates or serves is not one to build strangers' files on"
fi

part=$image.part
trap 'rm -f "$part"' EXIT
buildah bud --output "type=tar,dest=$part" "$@" --file "$submission/Dockerfile" "$submission"
mv "$part" "$image"
