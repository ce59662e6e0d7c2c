#!/bin/sh
# PDAL of this folder, started with its own C library and data files; the system's libraries are not touched.
# Found from the place of this file, so that the folder can be moved; exec, so that signals reach the program.
prefix=$(CDPATH='' cd -- "$(dirname -- "$(readlink -f -- "$0")")/.." && pwd -P) || exit 127
unset LD_LIBRARY_PATH LD_PRELOAD PDAL_DRIVER_PATH GDAL_DRIVER_PATH PROJ_DATA
PROJ_LIB=$prefix/usr/share/proj
GDAL_DATA=$prefix/usr/share/gdal
export PROJ_LIB GDAL_DATA
libraries=$prefix/usr/lib/@TRIPLET@
exec "$prefix/@LOADER@" --library-path \
    "$libraries:$prefix/lib/@TRIPLET@:$prefix/usr/lib:$libraries/blas:$libraries/lapack" \
    "$prefix/usr/bin/pdal" "$@"
