// A small refiner in C++: the cells above the ground that hang together with a candidate, and a box around their points.
//
// `mluc refiner-test -- build/refiner-cpp/refiner` tests it; `[stages.refiner] command = ["build/refiner-cpp/refiner"]` runs it.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <limits>
#include <numeric>
#include <vector>

#include "mluc.h"

namespace {

constexpr float kCellM = 0.4f;       // cells of this side hang together when they touch
constexpr int kSide = 24;            // cells of the area around a candidate, along each axis
constexpr float kClearanceM = 0.25f; // points lower than this above the ground belong to it
constexpr float kFarM = 1e4f;        // coordinates beyond this are nonsense
constexpr size_t kPointsMin = 10;    // a cluster with fewer is no object
constexpr float kReachM = kCellM * kSide / 2 - 0.01f;

bool is_sound(const mluc_point &p) {
    return std::fabs(p.x_m) < kFarM && std::fabs(p.y_m) < kFarM && std::fabs(p.z_m) < kFarM && std::isfinite(p.intensity);
}

class Refiner {
  public:
    std::vector<mluc_object> objects;
    std::vector<uint32_t> indices;
    uint32_t flags = 0;

    void refine(const mluc_frame &frame) {
        flags = 0;
        objects.clear();
        indices.clear();
        collect(frame);
        owner_.assign(frame.points_count, MLUC_NONE);
        for (size_t i = 0; i < frame.detections_count; ++i) objects.push_back(proposal(frame.detections[i]));
        // Known objects take their points first, then the surest candidates.
        order_.resize(objects.size());
        std::iota(order_.begin(), order_.end(), 0u);
        std::stable_sort(order_.begin(), order_.end(), [this](uint32_t a, uint32_t b) {
            const auto &left = objects[a], &right = objects[b];
            return left.kind != right.kind ? left.kind < right.kind : left.score > right.score;
        });
        for (uint32_t i : order_) one(frame.points, i);
        if (indices.size() > MLUC_OBJECT_POINTS_MAX) thin();
    }

  private:
    std::vector<uint32_t> sound_, near_, mine_, owner_, order_, votes_;
    std::vector<float> heights_;

    // Points that make sense; ingest sends no others, but this is shared memory.
    void collect(const mluc_frame &frame) {
        sound_.clear();
        for (size_t i = 0; i < frame.points_count; ++i) {
            if (is_sound(frame.points[i])) sound_.push_back(static_cast<uint32_t>(i));
        }
        if (sound_.size() < frame.points_count) flags |= MLUC_NOT_FINITE;
    }

    static mluc_object proposal(const mluc_detection &d) {
        mluc_object o{};
        o.kind = d.kind;
        o.suppressed_by = MLUC_NONE;
        o.track_id = MLUC_NONE;
        o.class_id = d.class_id;
        o.score = d.score;
        std::copy_n(d.center_m, 3, o.center_m);
        std::copy_n(d.size_m, 3, o.size_m);
        o.yaw_rad = d.yaw_rad;
        o.eds = d.eds;
        o.eds_normalised = d.eds_normalised;
        o.unknown_probability = d.unknown_probability;
        o.gate = d.gate;
        o.threshold = d.threshold;
        const bool is_far = std::any_of(d.center_m, d.center_m + 3, [](float v) { return std::fabs(v) > kFarM; }) ||
                            std::any_of(d.size_m, d.size_m + 3, [](float v) { return v > kFarM; });
        if (is_far) {
            o.disposition = MLUC_INVALID_BOX;
            std::fill_n(o.center_m, 3, 0.0f);
            std::fill_n(o.size_m, 3, 0.0f);
        } else {
            outline(o);
        }
        return o;
    }

    static void outline(mluc_object &o) {
        const float c = std::cos(o.yaw_rad), s = std::sin(o.yaw_rad);
        const float l = o.size_m[0] / 2, w = o.size_m[1] / 2;
        const float corners[4][2] = {{l, w}, {-l, w}, {-l, -w}, {l, -w}};
        for (int k = 0; k < 4; ++k) {
            o.footprint_m[k][0] = o.center_m[0] + c * corners[k][0] - s * corners[k][1];
            o.footprint_m[k][1] = o.center_m[1] + s * corners[k][0] + c * corners[k][1];
        }
        o.footprint_count = 4;
    }

    void one(const mluc_point *points, uint32_t i) {
        mluc_object &o = objects[i];
        if (o.disposition != MLUC_PUBLISHED) {
            flags |= MLUC_DEGRADED;
            return;
        }
        if (o.kind == MLUC_KNOWN) {
            inside(points, o);
        } else {
            cluster(points, o);
            if (mine_.size() < kPointsMin) {
                if (owner_.empty()) o.flags |= MLUC_UNREFINED;
                else o.disposition = MLUC_TOO_FEW_POINTS;
                return;
            }
            if (is_covered(o)) return;
            fit(points, o);
        }
        o.points_first = static_cast<uint32_t>(indices.size());
        for (uint32_t p : mine_) {
            if (owner_[p] != MLUC_NONE) continue;
            owner_[p] = i;
            indices.push_back(p);
        }
        o.points_count = static_cast<uint32_t>(indices.size()) - o.points_first;
    }

    // Every second point of each object, or fewer: all of them were more than the topic takes.
    void thin() {
        const size_t step = indices.size() / (MLUC_OBJECT_POINTS_MAX - MLUC_OBJECTS_MAX) + 1;
        std::vector<uint32_t> kept;
        for (auto &o : objects) {
            const auto first = static_cast<uint32_t>(kept.size());
            for (size_t k = 0; k < o.points_count; k += step) kept.push_back(indices[o.points_first + k]);
            o.points_first = first;
            o.points_count = static_cast<uint32_t>(kept.size()) - first;
            o.flags |= MLUC_THINNED;
        }
        indices.swap(kept);
        flags |= MLUC_LIMIT_HIT | MLUC_LIMIT_OBJECT_POINTS;
    }

    // Points in a known object's box.
    void inside(const mluc_point *points, const mluc_object &o) {
        const float c = std::cos(o.yaw_rad), s = std::sin(o.yaw_rad);
        mine_.clear();
        for (uint32_t p : sound_) {
            const float dx = points[p].x_m - o.center_m[0], dy = points[p].y_m - o.center_m[1];
            const bool is_in = std::fabs(c * dx + s * dy) < o.size_m[0] / 2 && std::fabs(c * dy - s * dx) < o.size_m[1] / 2 &&
                               std::fabs(points[p].z_m - o.center_m[2]) < o.size_m[2] / 2;
            if (is_in) mine_.push_back(p);
        }
    }

    static int cell(float off) { return static_cast<int>(off / kCellM + kSide / 2.0f) + 1; }

    // Points above the ground whose cells hang together with that of the point nearest to the candidate.
    void cluster(const mluc_point *points, const mluc_object &o) {
        near_.clear();
        mine_.clear();
        heights_.clear();
        for (uint32_t p : sound_) {
            const float dx = points[p].x_m - o.center_m[0], dy = points[p].y_m - o.center_m[1];
            if (std::fabs(dx) >= kReachM || std::fabs(dy) >= kReachM) continue;
            near_.push_back(p);
            heights_.push_back(points[p].z_m);
        }
        if (near_.empty()) return;
        const auto tenth = heights_.begin() + static_cast<std::ptrdiff_t>(heights_.size() / 10);
        std::nth_element(heights_.begin(), tenth, heights_.end());
        const float floor_m = *tenth + kClearanceM;
        std::array<std::array<bool, kSide + 2>, kSide + 2> filled{};
        float nearest = std::numeric_limits<float>::max();
        int seed_x = -1, seed_y = -1;
        for (uint32_t p : near_) {
            if (points[p].z_m <= floor_m) continue;
            const float dx = points[p].x_m - o.center_m[0], dy = points[p].y_m - o.center_m[1];
            filled[cell(dx)][cell(dy)] = true;
            if (dx * dx + dy * dy < nearest) {
                nearest = dx * dx + dy * dy;
                seed_x = cell(dx);
                seed_y = cell(dy);
            }
        }
        if (seed_x < 0) return;
        std::array<std::array<bool, kSide + 2>, kSide + 2> grown{};
        std::vector<std::pair<int, int>> open{{seed_x, seed_y}};
        grown[seed_x][seed_y] = true;
        while (!open.empty()) {
            const auto [x, y] = open.back();
            open.pop_back();
            for (int nx = x - 1; nx <= x + 1; ++nx) {
                for (int ny = y - 1; ny <= y + 1; ++ny) {
                    // The outermost cells are never filled: no step leaves the area.
                    if (!filled[nx][ny] || grown[nx][ny]) continue;
                    grown[nx][ny] = true;
                    open.emplace_back(nx, ny);
                }
            }
        }
        for (uint32_t p : near_) {
            const float dx = points[p].x_m - o.center_m[0], dy = points[p].y_m - o.center_m[1];
            if (points[p].z_m > floor_m && grown[cell(dx)][cell(dy)]) mine_.push_back(p);
        }
    }

    // Whether most of its points belong to another object.
    bool is_covered(mluc_object &o) {
        votes_.assign(objects.size(), 0);
        for (uint32_t p : mine_) {
            if (owner_[p] != MLUC_NONE) ++votes_[owner_[p]];
        }
        const auto most = std::max_element(votes_.begin(), votes_.end());
        if (2 * static_cast<size_t>(*most) <= mine_.size()) return false;
        o.suppressed_by = static_cast<uint32_t>(most - votes_.begin());
        o.disposition = objects[o.suppressed_by].kind == MLUC_KNOWN ? MLUC_OVERLAPS_KNOWN : MLUC_OVERLAPS_UNKNOWN;
        o.overlap = static_cast<float>(*most) / static_cast<float>(mine_.size());
        return true;
    }

    // The box along the main axis of the points, seen from above.
    void fit(const mluc_point *points, mluc_object &o) const {
        double x = 0, y = 0, xx = 0, xy = 0, yy = 0;
        for (uint32_t p : mine_) {
            x += points[p].x_m;
            y += points[p].y_m;
        }
        x /= static_cast<double>(mine_.size());
        y /= static_cast<double>(mine_.size());
        for (uint32_t p : mine_) {
            const double dx = points[p].x_m - x, dy = points[p].y_m - y;
            xx += dx * dx;
            xy += dx * dy;
            yy += dy * dy;
        }
        const double yaw = 0.5 * std::atan2(2 * xy, xx - yy), c = std::cos(yaw), s = std::sin(yaw);
        double low[3], high[3];
        std::fill_n(low, 3, std::numeric_limits<double>::max());
        std::fill_n(high, 3, std::numeric_limits<double>::lowest());
        for (uint32_t p : mine_) {
            const double dx = points[p].x_m - x, dy = points[p].y_m - y;
            const double at[3] = {c * dx + s * dy, c * dy - s * dx, points[p].z_m};
            for (int k = 0; k < 3; ++k) {
                low[k] = std::min(low[k], at[k]);
                high[k] = std::max(high[k], at[k]);
            }
        }
        const double along = (low[0] + high[0]) / 2, across = (low[1] + high[1]) / 2;
        o.center_m[0] = static_cast<float>(x + c * along - s * across);
        o.center_m[1] = static_cast<float>(y + s * along + c * across);
        o.center_m[2] = static_cast<float>((low[2] + high[2]) / 2);
        for (int k = 0; k < 3; ++k) o.size_m[k] = static_cast<float>(std::max(high[k] - low[k], 0.1));
        o.yaw_rad = static_cast<float>(yaw);
        outline(o);
    }
};

} // namespace

int main() {
    if (mluc_wire_version() != MLUC_WIRE_VERSION) {
        std::fprintf(stderr, "mluc.h is of wire version %u, the library speaks %u\n", MLUC_WIRE_VERSION, mluc_wire_version());
        return 1;
    }
    mluc_refiner *stage = nullptr;
    int32_t code = mluc_refiner_open(&stage);
    Refiner refiner;
    while (code == MLUC_OK || code == MLUC_TIMEOUT) {
        mluc_frame frame;
        code = mluc_refiner_wait(stage, 100, &frame);
        if (code != MLUC_OK) continue;
        refiner.refine(frame);
        code = mluc_refiner_publish(stage, refiner.objects.data(), refiner.objects.size(), refiner.indices.data(),
                                    refiner.indices.size(), refiner.flags);
    }
    if (code != MLUC_STOPPING) std::fprintf(stderr, "refiner: %s\n", mluc_last_error());
    mluc_refiner_close(stage);
    return code == MLUC_STOPPING ? 0 : 1;
}
