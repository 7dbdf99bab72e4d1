// A node of a host application, as small as it can be: it has a garment and a body in its own memory, feeds the body live
// frame by frame, reads the cloth without a copy, and goes back when somebody scrubs. Start from here.
//
//   c++ -std=c++17 live_node.cpp $(pkg-config --cflags --libs drapery_c)
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <map>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "drapery.h"

namespace {

// Turns a code into an exception; the error is freed.
class Call {
public:
    drapery_error **operator&() { return &error_; }

    void done(int32_t code) {
        if (code == DRAPERY_DONE) return;
        std::string text = error_ ? drapery_error_message(error_) : "code " + std::to_string(code);
        int64_t frame;
        if (drapery_error_frame(error_, &frame)) text += " (frame " + std::to_string(frame) + ")";
        drapery_error_free(error_);
        error_ = nullptr;
        throw std::runtime_error(text);
    }

private:
    drapery_error *error_ = nullptr;
};

struct Free {
    void operator()(drapery_scene *scene) const { drapery_scene_free(scene); }
    void operator()(drapery_simulation *simulation) const { drapery_simulation_free(simulation); }
    void operator()(drapery_state *state) const { drapery_state_free(state); }
};

template <class T>
using Handle = std::unique_ptr<T, Free>;

// A mesh as the host has it: points in metres with Y up, faces counter-clockwise seen from outside.
struct Mesh {
    std::vector<double> points;
    std::vector<uint32_t> counts, corners;
};

// A square of n by n points at a height, from -side / 2 to side / 2.
Mesh square(uint32_t n, double side, double height) {
    Mesh mesh;
    for (uint32_t i = 0; i < n * n; ++i) {
        const double x = side * (double(i % n) / (n - 1) - 0.5), z = side * (double(i / n) / (n - 1) - 0.5);
        mesh.points.insert(mesh.points.end(), {x, height, z});
    }
    for (uint32_t row = 0; row + 1 < n; ++row) {
        for (uint32_t i = row * n; i + 1 < row * n + n; ++i) {
            mesh.counts.push_back(4);
            mesh.corners.insert(mesh.corners.end(), {i, i + n, i + n + 1, i + 1});
        }
    }
    return mesh;
}

class ClothNode {
public:
    // What the artist sets stands in a scene, with the meshes of the host in the place of files.
    ClothNode(const char *scene_text, const Mesh &cloth, const Mesh &body) {
        drapery_scene *scene = nullptr;
        call_.done(drapery_scene_parse(scene_text, "node", "", &scene, &call_));
        Handle<drapery_scene> owner(scene);
        add(scene, "cloth", cloth);
        add(scene, "body", body);
        drapery_simulation *simulation = nullptr;
        call_.done(drapery_simulation_new(scene, &simulation, &call_));
        simulation_.reset(simulation);
        for (size_t i = 0; i < drapery_simulation_warning_count(simulation); ++i) {
            std::fprintf(stderr, "warning: %s\n", drapery_simulation_warning(simulation, i));
        }
    }

    // Goes on by one frame, with the body where the host has it at its end.
    void evaluate(const std::vector<double> &body) {
        keep();
        call_.done(drapery_simulation_move_body(simulation_.get(), 0, body.data(), body.size() / 3, &call_));
        call_.done(drapery_simulation_advance(simulation_.get(), nullptr, nullptr, &call_));
    }

    // Goes back to a frame that was evaluated before.
    void scrub(int64_t frame) {
        call_.done(drapery_simulation_restore(simulation_.get(), states_.at(frame).get(), &call_));
    }

    int64_t frame() {
        int64_t frame = 0;
        call_.done(drapery_simulation_frame(simulation_.get(), &frame, &call_));
        return frame;
    }

    // The cloth, without a copy; valid until the node goes on.
    const double *points(size_t &count) {
        const double *points = nullptr;
        call_.done(drapery_simulation_positions(simulation_.get(), 0, &points, &count, &call_));
        return points;
    }

private:
    void add(drapery_scene *scene, const char *name, const Mesh &mesh) {
        call_.done(drapery_scene_add_mesh(scene, name, mesh.points.data(), mesh.points.size() / 3, mesh.counts.data(),
                                          mesh.counts.size(), mesh.corners.data(), mesh.corners.size(), &call_));
    }

    void keep() {
        drapery_state *state = nullptr;
        call_.done(drapery_simulation_save(simulation_.get(), &state, &call_));
        states_[frame()].reset(state);
    }

    Call call_;
    Handle<drapery_simulation> simulation_;
    std::map<int64_t, Handle<drapery_state>> states_;
};

const char *scene = R"(
drapery = 1
[shot]
name = "node"
frames = "0-1000"
[gravity]
[self_collision]
[[body]]
name = "plate"
file = "memory:body"
friction = 0.4
[[garment]]
name = "cloth"
rest = "memory:cloth"
density = "500 g/m²"
stretch = { stiffness = "200 N/m" }
)";

// The host's plate rises by 1 cm a frame for ten frames.
Mesh plate(int64_t frame) { return square(2, 2.0, 0.01 * double(frame < 10 ? frame : 10)); }

}  // namespace

int main() try {
    ClothNode node(scene, square(11, 0.5, 0.005), plate(0));
    std::vector<double> seen;
    size_t count = 0;
    for (int64_t frame = 1; frame <= 24; ++frame) {
        node.evaluate(plate(frame).points);
        const double *points = node.points(count);
        double lowest = points[1];
        for (size_t i = 0; i < count; ++i) lowest = points[3 * i + 1] < lowest ? points[3 * i + 1] : lowest;
        std::printf("frame %d: lowest point at %.6f m\n", int(frame), lowest);
        if (frame == 12) seen.assign(points, points + 3 * count);
    }
    node.scrub(11);
    node.evaluate(plate(12).points);
    const bool same = std::memcmp(node.points(count), seen.data(), sizeof(double) * seen.size()) == 0;
    std::printf("frame 12 again: %s\n", same ? "the same bits" : "other bits");
    return same ? EXIT_SUCCESS : EXIT_FAILURE;
} catch (const std::exception &error) {
    std::fprintf(stderr, "%s\n", error.what());
    return EXIT_FAILURE;
}
