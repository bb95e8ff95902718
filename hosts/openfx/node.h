// SPDX-License-Identifier: Apache-2.0
// A node: a row of the table (nodes.json), and the actions of OpenFX on its instances. It has no state of its own.
#pragma once

#include "frame.h"

namespace oiiotex {

class Node {
public:
    explicit Node(const Json& facts) : m_facts(facts) {}

    // Actions: `in` has the arguments of the host, `out` takes the answer.
    ofx::Status describe(const Effect& effect, const Properties& in, const Properties& out) const;
    ofx::Status describe_in_context(const Effect& effect, const Properties& in, const Properties& out) const;
    ofx::Status clip_preferences(const Effect& effect, const Properties& in, const Properties& out) const;
    ofx::Status region_of_definition(const Effect& effect, const Properties& in, const Properties& out) const;
    ofx::Status regions_of_interest(const Effect& effect, const Properties& in, const Properties& out) const;
    ofx::Status frames_needed(const Effect& effect, const Properties& in, const Properties& out) const;
    ofx::Status is_identity(const Effect& effect, const Properties& in, const Properties& out) const;
    ofx::Status output_space(const Effect& effect, const Properties& in, const Properties& out) const;
    ofx::Status created(const Effect& effect, const Properties& in, const Properties& out) const;
    ofx::Status changed(const Effect& effect, const Properties& in, const Properties& out) const;
    ofx::Status render(const Effect& effect, const Properties& in, const Properties& out) const;

private:
    // What one frame depends on.
    struct Moment {
        double time, scale_x, scale_y;
    };

    const Json& m_facts;

    bool flag(const char* name) const { return m_facts.at(name); }
    bool keeps_space(const Effect& effect) const;  // and the state of alpha
    const Json& output(const Effect& effect, double time) const;  // the chosen one
    double frame_of(const Effect& effect, const Json& input, double time) const;
    Json values(const Effect& effect, const Moment& moment) const;     // modifiers of the op that are not defaults
    std::string space(const Effect& effect, double time) const;        // empty: unknown
    bool lacks_space(const Effect& effect, double time) const;         // although it needs one
    ofx::RectD plane(const Effect& effect, double time) const;         // region of a node of any window
    std::string line(const Effect& effect, double time) const;         // the command line of these pixels
    Json request(const Effect& effect, const Moment& moment) const;    // without images
    Json plan(const Effect& effect, double time) const;                // a request at full size, without pixels
    std::vector<Input> inputs(const Effect& effect, double time) const;
    std::shared_ptr<const Frame> frame(const Effect& effect, Json asked, const std::vector<Input>& images,
                                       const Moment& moment) const;
};

}  // namespace oiiotex
