# find_package(drapery_c 0.1) gives drapery_c::shared and drapery_c::static.
get_filename_component(_drapery_prefix "${CMAKE_CURRENT_LIST_DIR}/../../.." ABSOLUTE)

if(NOT TARGET drapery_c::shared)
    add_library(drapery_c::shared SHARED IMPORTED)
    set_target_properties(drapery_c::shared PROPERTIES
        IMPORTED_LOCATION "${_drapery_prefix}/lib/libdrapery_c.so"
        IMPORTED_NO_SONAME TRUE
        INTERFACE_INCLUDE_DIRECTORIES "${_drapery_prefix}/include")
endif()

if(NOT TARGET drapery_c::static)
    find_library(DRAPERY_HDF5 NAMES hdf5 hdf5_serial PATH_SUFFIXES hdf5/serial)
    add_library(drapery_c::static STATIC IMPORTED)
    set_target_properties(drapery_c::static PROPERTIES
        IMPORTED_LOCATION "${_drapery_prefix}/lib/libdrapery_c.a"
        INTERFACE_LINK_LIBRARIES "${DRAPERY_HDF5};m;pthread;dl"
        INTERFACE_INCLUDE_DIRECTORIES "${_drapery_prefix}/include")
endif()

unset(_drapery_prefix)
