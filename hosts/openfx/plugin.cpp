// SPDX-License-Identifier: Apache-2.0
// The functions that a host calls: one plugin for each node of the table.
#include "node.h"

#include <map>
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

using Action = ofx::Status (Node::*)(const Effect&, const Properties& in, const Properties& out) const;

// What a node does, by the host's name for it; nullptr: nothing.
Action action_of(const std::string& name)
{
    static const auto& actions = *new std::map<std::string, Action> {
        { "OfxActionDescribe", &Node::describe },
        { "OfxImageEffectActionDescribeInContext", &Node::describe_in_context },
        { "OfxActionCreateInstance", &Node::created },
        { "OfxActionInstanceChanged", &Node::changed },
        { "OfxImageEffectActionGetClipPreferences", &Node::clip_preferences },
        { "OfxImageEffectActionGetOutputColourspace", &Node::output_space },
        { "OfxImageEffectActionGetRegionOfDefinition", &Node::region_of_definition },
        { "OfxImageEffectActionGetRegionsOfInterest", &Node::regions_of_interest },
        { "OfxImageEffectActionGetFramesNeeded", &Node::frames_needed },
        { "OfxImageEffectActionIsIdentity", &Node::is_identity },
        { "OfxImageEffectActionRender", &Node::render },
    };
    const auto found = actions.find(name);
    return found == actions.end() ? nullptr : found->second;
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
        const Action act = action_of(name);
        return act ? (Node(nodes().at(number)).*act)(effect, in, out) : ofx::reply_default;
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
