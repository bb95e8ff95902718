// SPDX-License-Identifier: Apache-2.0
// The functions that a host calls: one plugin for each node of the table.
#include "node.h"

#include <new>
#include <utility>

namespace oiiotex {

extern const char* const table;  // nodes.json, put into the library by CMake

namespace {

constexpr size_t most_nodes = 24;
ofx::Host* host             = nullptr;

// The nodes; the table is read once, and never destroyed.
const std::vector<Json>& nodes()
{
    static const auto& list = *new std::vector<Json>(Json::parse(table).at("nodes").get<std::vector<Json>>());
    return list;
}

ofx::Status load()
{
    if (!host)
        return ofx::missing_feature;
    const auto suite = [](const char* name, int version) { return host->suite(host->properties, name, version); };
    suites.property  = static_cast<const ofx::PropertySuite*>(suite("OfxPropertySuite", 1));
    suites.effect    = static_cast<const ofx::EffectSuite*>(suite("OfxImageEffectSuite", 1));
    suites.parameter = static_cast<const ofx::ParameterSuite*>(suite("OfxParameterSuite", 1));
    suites.message   = static_cast<const ofx::MessageSuite*>(suite("OfxMessageSuite", 2));
    suites.progress  = static_cast<const ofx::ProgressSuite*>(suite("OfxProgressSuite", 1));
    return suites.property && suites.effect && suites.parameter ? ofx::ok : ofx::missing_feature;
}

ofx::Status act(const Node& node, const std::string& action, const Effect& effect, const Properties& in,
                const Properties& out)
{
    if (action == "OfxImageEffectActionRender")
        return node.render(effect, in);
    if (action == "OfxActionDescribe")
        return node.describe(effect);
    if (action == "OfxImageEffectActionDescribeInContext")
        return node.describe_in_context(effect, in);
    if (action == "OfxImageEffectActionGetClipPreferences")
        return node.clip_preferences(effect, out);
    if (action == "OfxImageEffectActionGetRegionOfDefinition")
        return node.region_of_definition(effect, in, out);
    if (action == "OfxImageEffectActionGetRegionsOfInterest")
        return node.regions_of_interest(effect, in, out);
    if (action == "OfxImageEffectActionGetFramesNeeded")
        return node.frames_needed(effect, in, out);
    if (action == "OfxImageEffectActionIsIdentity")
        return node.is_identity(effect, in, out);
    if (action == "OfxImageEffectActionGetOutputColourspace")
        return node.output_space(effect, out);
    if (action == "OfxActionCreateInstance")
        return node.created(effect);
    if (action == "OfxActionInstanceChanged")
        return node.changed(effect, in);
    return ofx::reply_default;
}

template<size_t number>
ofx::Status main_entry(const char* action, const void* handle, void* in, void* out) noexcept
{
    const Effect effect(handle);
    try {
        const std::string name = action ? action : "";
        if (name == "OfxActionLoad")
            return load();
        if (name == "OfxActionUnload")
            return ofx::ok;
        if (!handle || !suites.property)
            return ofx::failed;
        return act(Node(nodes().at(number)), name, effect, Properties(in), Properties(out));
    } catch (const std::bad_alloc&) {
        return ofx::out_of_memory;
    } catch (const Canceled&) {
        return ofx::ok;
    } catch (const Json::exception&) {
        effect.show_error("invalid message from the oiiotex process");
    } catch (const std::exception& error) {
        effect.show_error(error.what());
    }
    return ofx::failed;
}

void set_host(ofx::Host* given)
{
    host = given;
}

template<size_t... numbers> std::vector<ofx::Plugin> plugins(std::index_sequence<numbers...>)
{
    return { { "OfxImageEffectPluginAPI", 1, nullptr, OIIOTEX_MAJOR, OIIOTEX_MINOR, set_host, main_entry<numbers> }... };
}

// Plugins with their identifiers; never destroyed.
std::vector<ofx::Plugin>& all_plugins()
{
    static auto& names   = *new std::vector<std::string>;
    static auto& plugins = *new std::vector<ofx::Plugin>([] {
        for (const Json& node : nodes())
            names.push_back("org.oiiotex." + node.at("name").get<std::string>());
        auto list = oiiotex::plugins(std::make_index_sequence<most_nodes>());
        list.resize(names.size());
        for (size_t n = 0; n < names.size(); ++n)
            list[n].identifier = names[n].c_str();
        return list;
    }());
    return plugins;
}

}  // namespace
}  // namespace oiiotex

extern "C" {

__attribute__((visibility("default"))) int OfxGetNumberOfPlugins() noexcept
{
    return int(oiiotex::all_plugins().size());
}

__attribute__((visibility("default"))) ofx::Plugin* OfxGetPlugin(int number) noexcept
{
    auto& plugins = oiiotex::all_plugins();
    return number >= 0 && number < int(plugins.size()) ? &plugins[number] : nullptr;
}
}
