# find_package(nunet) defines:
#   nunet::nunet   the shared library (the static one where no shared one is installed)
#   nunet::static  the static library
# Both bring the include directory of nunet.h and nunet.hpp.
#
# Installed as LIBDIR/cmake/nunet/nunetConfig.cmake; everything is found from there, so the folder may be moved.

get_filename_component(_nunet_libdir "${CMAKE_CURRENT_LIST_DIR}/../.." ABSOLUTE)
find_path(nunet_INCLUDE_DIR nunet.h
  PATHS "${_nunet_libdir}/../include" "${_nunet_libdir}/../../include" NO_DEFAULT_PATH)
mark_as_advanced(nunet_INCLUDE_DIR)

include(CMakeFindDependencyMacro)
find_dependency(Threads)

if(NOT TARGET nunet::static AND EXISTS "${_nunet_libdir}/libnunet.a")
  add_library(nunet::static STATIC IMPORTED)
  set_target_properties(nunet::static PROPERTIES
    IMPORTED_LOCATION "${_nunet_libdir}/libnunet.a"
    INTERFACE_INCLUDE_DIRECTORIES "${nunet_INCLUDE_DIR}"
    INTERFACE_LINK_LIBRARIES "Threads::Threads;${CMAKE_DL_LIBS};m;rt;util")
endif()

if(NOT TARGET nunet::nunet)
  if(EXISTS "${_nunet_libdir}/libnunet.so")
    add_library(nunet::nunet SHARED IMPORTED)
    set_target_properties(nunet::nunet PROPERTIES
      IMPORTED_LOCATION "${_nunet_libdir}/libnunet.so"
      IMPORTED_SONAME "libnunet.so.0"
      INTERFACE_INCLUDE_DIRECTORIES "${nunet_INCLUDE_DIR}")
  elseif(TARGET nunet::static)
    add_library(nunet::nunet INTERFACE IMPORTED)
    set_target_properties(nunet::nunet PROPERTIES INTERFACE_LINK_LIBRARIES nunet::static)
  endif()
endif()

include(FindPackageHandleStandardArgs)
set(nunet_LIBRARY_DIR "${_nunet_libdir}")
if(TARGET nunet::nunet)
  set(nunet_HAS_LIBRARY TRUE)
endif()
find_package_handle_standard_args(nunet REQUIRED_VARS nunet_LIBRARY_DIR nunet_INCLUDE_DIR nunet_HAS_LIBRARY)
unset(_nunet_libdir)
