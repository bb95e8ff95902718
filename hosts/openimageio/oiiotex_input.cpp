// SPDX-License-Identifier: Apache-2.0
// `wall.oiiotex` as an OpenImageIO image: an unbounded texture, tiled and MIP-mapped, computed on demand, or the maps of
// an indexed image as subimages.

#include "resident.h"

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>
#include <OpenImageIO/strutil.h>

#include <algorithm>
#include <cstdlib>
#include <memory>
#include <vector>

OIIO_PLUGIN_NAMESPACE_BEGIN

class OiiotexInput final : public ImageInput {
public:
    // Not "oiiotex": OpenImageIO's writers drop attributes whose prefix names another format, so `oiiotex:seed` would be
    // lost. The names of the file and of the exported functions follow from the format's.
    const char* format_name() const override { return "oiiotexfile"; }

    // "procedural": the name may have a query after '?', so hosts do not check whether the file exists.
    int supports(string_view feature) const override { return feature == "procedural" || feature == "mipmap" || feature == "multiimage"; }

    bool valid_file(const std::string& name) const override { return is_ours(name); }

    bool open(const std::string& name, ImageSpec& newspec) override
    {
        close();
        if (!is_ours(name)) {  // hosts try every reader for an unknown file
            errorfmt("\"{}\" is not an .oiiotex file", name);
            return false;
        }
        return guarded([&] {
            if (std::getenv("OIIOTEX_RESIDENT"))  // it would wait for itself
                throw oiiotex::Error(name + " is already a texture: expected the photo or graph that it is made from");
            auto texture                = std::make_unique<oiiotex::Texture>(name);
            const oiiotex::Reply answer = texture->ask("texture");
            std::vector<ImageSpec> parts;
            for (const std::string xml : answer.facts.at("specs"))
                parts.push_back(checked_spec(xml));
            const int64_t levels = answer.facts.at("levels");
            if (parts.empty() || levels < 1 || levels > 31)
                throw oiiotex::Error("the oiiotex process sent an invalid image");
            m_texture = std::move(texture);
            m_levels  = int(levels);
            m_parts   = std::move(parts);
            m_part = m_level = 0;
            m_spec = newspec = m_parts[0];
        });
    }

    bool close() override
    {
        m_texture.reset();
        m_parts.clear();
        m_levels = 0;
        return true;
    }

    int current_subimage() const override { return m_part; }
    int current_miplevel() const override { return m_level; }

    bool seek_subimage(int subimage, int miplevel) override
    {
        lock_guard guard(*this);
        if (!has(subimage, miplevel))
            return false;
        m_part  = subimage;
        m_level = miplevel;
        m_spec  = level_spec(subimage, miplevel);
        return true;
    }

    // Neither of these changes the current position, so threads need not wait for each other.
    ImageSpec spec(int subimage, int miplevel) override
    {
        return has(subimage, miplevel) ? level_spec(subimage, miplevel) : ImageSpec();
    }
    ImageSpec spec_dimensions(int subimage, int miplevel) override
    {
        ImageSpec dimensions;
        if (has(subimage, miplevel))
            dimensions.copy_dimensions(level_spec(subimage, miplevel));
        return dimensions;
    }

    bool read_native_tile(int subimage, int miplevel, int x, int y, int /*z*/, void* data) override
    {
        const ImageSpec level = spec_dimensions(subimage, miplevel);
        if (!m_texture || level.undefined()) {
            errorfmt("no MIP level {} in subimage {}", miplevel, subimage);
            return false;
        }
        return guarded([&] {
            const oiiotex::Json window { x, y, int64_t(x) + level.tile_width, int64_t(y) + level.tile_height };
            m_texture->ask("tile", { { "part", subimage }, { "level", miplevel }, { "window", window } })
                .copy_pixels(data, level.tile_bytes(true));
        });
    }

    bool read_native_scanline(int /*subimage*/, int /*miplevel*/, int /*y*/, int /*z*/, void* /*data*/) override
    {
        errorfmt("an .oiiotex file must be read by tiles");
        return false;
    }

private:
    std::unique_ptr<oiiotex::Texture> m_texture;
    std::vector<ImageSpec> m_parts;  // of the finest levels
    int m_levels = 0;
    int m_part   = 0;
    int m_level  = 0;

    static bool is_ours(const std::string& name)
    {
        return Strutil::iends_with(Filesystem::exists(name) ? name : name.substr(0, name.find('?')), ".oiiotex");
    }

    static ImageSpec checked_spec(const std::string& xml)
    {
        ImageSpec spec;
        spec.from_xml(xml.c_str());
        if (spec.width < 1 || spec.height < 1 || spec.nchannels < 1 || spec.tile_width < 1 || spec.tile_height < 1
            || spec.format == TypeUnknown)
            throw oiiotex::Error("the oiiotex process sent an invalid image spec");
        spec.depth = spec.full_depth = spec.tile_depth = 1;
        return spec;
    }

    bool has(int part, int level) const
    {
        return part >= 0 && part < int(m_parts.size()) && level >= 0 && level < m_levels;
    }

    ImageSpec level_spec(int part, int level) const
    {
        ImageSpec spec = m_parts[part];
        spec.width = spec.full_width = std::max(1, spec.width >> level);
        spec.height = spec.full_height = std::max(1, spec.height >> level);
        return spec;
    }

    // Whether `work` succeeded; otherwise its error is reported to the host, and no exception leaves.
    template<typename Work> bool guarded(const Work& work)
    {
        try {
            work();
            return true;
        } catch (const oiiotex::Json::exception&) {
            errorfmt("oiiotex ERROR: invalid message from the oiiotex process");
        } catch (const std::exception& error) {
            errorfmt("oiiotex ERROR: {}", error.what());
        }
        return false;
    }
};

OIIO_PLUGIN_NAMESPACE_END

extern "C" OIIO_EXPORT void* oiiotex_reader_create()
{
    return static_cast<OIIO::ImageInput*>(new OIIO::OiiotexInput);
}
