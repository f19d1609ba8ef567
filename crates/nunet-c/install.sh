#!/bin/sh
# Installs libnunet for C and C++: libraries, headers, pkg-config file and CMake package.
#
#   crates/nunet-c/install.sh BUILT PREFIX [LIBDIR]
#
# BUILT is the folder with libnunet.so and libnunet.a (target/release after `cargo build --release -p nunet-c`). PREFIX is
# where programs find it, such as /usr/local; LIBDIR is relative to it (default lib; Debian packages use
# lib/x86_64-linux-gnu). For a package, DESTDIR is put before every path that is written.
set -eu

if [ $# -lt 2 ] || [ $# -gt 3 ]; then
  echo "usage: $0 BUILT PREFIX [LIBDIR]" >&2
  exit 2
fi
built=$1 prefix=$2 libdir=${3:-lib}
here=$(CDPATH='' cd -- "$(dirname -- "$0")" && pwd)
version=$(sed -n 's/^#define NUNET_VERSION "\(.*\)"$/\1/p' "$here/include/nunet.h")
soname=libnunet.so.0
for file in "$built/libnunet.so" "$built/libnunet.a"; do
  if [ ! -e "$file" ]; then
    echo "error: $file does not exist; run cargo build --release -p nunet-c" >&2
    exit 1
  fi
done

root=${DESTDIR:-}$prefix
lib=$root/$libdir
install -d "$root/include" "$lib/pkgconfig" "$lib/cmake/nunet"
install -m 644 "$here/include/nunet.h" "$here/include/nunet.hpp" "$root/include"
install -m 644 "$built/libnunet.a" "$lib"
# Cargo strips programs and shared libraries, but not archives: the standard library's debug information and bitcode are
# 31 of 49 MB.
if command -v objcopy > /dev/null; then
  objcopy --strip-unneeded --remove-section=.llvmbc --remove-section=.llvmcmd "$lib/libnunet.a"
fi
install -m 755 "$built/libnunet.so" "$lib/libnunet.so.$version"
ln -sf "libnunet.so.$version" "$lib/$soname"
ln -sf "$soname" "$lib/libnunet.so"
sed "s|@PREFIX@|$prefix|; s|@LIBDIR@|\${prefix}/$libdir|; s|@VERSION@|$version|" "$here/nunet.pc.in" \
  > "$lib/pkgconfig/nunet.pc"
install -m 644 "$here/cmake/nunetConfig.cmake" "$lib/cmake/nunet"
sed "s|@VERSION@|$version|" "$here/cmake/nunetConfigVersion.cmake.in" > "$lib/cmake/nunet/nunetConfigVersion.cmake"
