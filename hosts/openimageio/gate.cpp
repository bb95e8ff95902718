// SPDX-License-Identifier: Apache-2.0
// The plugin as OpenImageIO loads it. It requires no OpenImageIO itself, so that it loads into any version, and loads the
// reader, which requires the version that it was built for. If that is missing, it reports both in one line, and gives a
// plugin version that no OpenImageIO accepts: a creator that returns no reader would crash OpenImageIO 3.1.

#include <OpenImageIO/imageio.h>  // for its macros alone

#include <cstdio>
#include <string>

#include <dlfcn.h>

namespace {

void* opened_reader()
{
    Dl_info info;
    if (!dladdr(reinterpret_cast<void*>(&opened_reader), &info))
        return nullptr;
    const std::string path(info.dli_fname);
    return dlopen((path.substr(0, path.rfind('/') + 1) + "oiiotex_reader.so").c_str(), RTLD_NOW | RTLD_LOCAL);
}

using Creator = void* (*)();

Creator creator()
{
    if (void* reader = opened_reader())
        if (void* create = dlsym(reader, "oiiotex_reader_create"))
            return reinterpret_cast<Creator>(create);
    const char* reason = dlerror();
    std::fprintf(stderr,
                 "oiiotex ERROR: the plugin for .oiiotex files was built for OpenImageIO " OIIO_VERSION_STRING
                 ", which this program does not have (%s): build it for the program's own: docs/how-to/hosts.md\n",
                 reason ? reason : "no reason given");
    return nullptr;
}

const Creator create = creator();  // when the host loads the plugin

}  // namespace

extern "C" {

OIIO_EXPORT int oiiotexfile_imageio_version = create ? OIIO_PLUGIN_VERSION : 0;

OIIO_EXPORT const char* oiiotexfile_imageio_library_version()
{
    return "oiiotex " OIIOTEX_VERSION;
}

OIIO_EXPORT void* oiiotexfile_input_imageio_create()
{
    return create();
}

OIIO_EXPORT const char* oiiotexfile_input_extensions[] = { "oiiotex", nullptr };
}
