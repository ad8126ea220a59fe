// A consumer in C++: the published objects of each frame and their points, a line of JSON each. It only reads: `mluc up` neither knows
// it nor waits for it. `MLUC_INSTANCE=default build/consumer-cpp/consumer`

#include <cstdio>

#include "mluc.h"

namespace {

const char *const kStates[] = {"starting", "running", "degraded", "blind", "late", "stopped"};

void print(const mluc_result &result, bool is_first, const mluc_object &object) {
    // A name of 32 bytes has no NUL behind it.
    const char *name = object.kind == MLUC_UNKNOWN ? "unknown" : result.run->class_names[object.class_id];
    // None of them is there where a scan's points are gone.
    const size_t count = result.indices_count == 0 ? 0 : object.points_count;
    float top_m = 0;
    for (size_t i = 0; i < count; ++i) {
        const float z_m = result.points[result.indices[object.points_first + i]].z_m;
        if (i == 0 || z_m > top_m) top_m = z_m;
    }
    std::printf("%s{\"class\": \"%.32s\", \"score\": %g, \"center_m\": [%g, %g, %g], \"size_m\": [%g, %g, %g], \"yaw_rad\": %g, "
                "\"points\": %zu, \"top_m\": %g}",
                is_first ? "" : ", ", name, object.score, object.center_m[0], object.center_m[1], object.center_m[2], object.size_m[0],
                object.size_m[1], object.size_m[2], object.yaw_rad, count, top_m);
}

}  // namespace

int main() {
    if (mluc_wire_version() != MLUC_WIRE_VERSION) {
        std::fprintf(stderr, "mluc.h is of wire version %u, the library speaks %u\n", MLUC_WIRE_VERSION, mluc_wire_version());
        return 1;
    }
    mluc_consumer *consumer = nullptr;
    if (mluc_consumer_open(&consumer) != MLUC_OK) {
        std::fprintf(stderr, "consumer: %s\n", mluc_last_error());
        return 1;
    }
    int32_t code = MLUC_OK;
    while (code == MLUC_OK || code == MLUC_TIMEOUT) {
        mluc_result result;
        code = mluc_consumer_wait(consumer, 1000, &result);
        const char *state = result.status ? kStates[result.status->state] : kStates[0];
        if (code == MLUC_TIMEOUT) std::fprintf(stderr, "no frame: %s\n", state);
        if (code != MLUC_OK) continue;
        // The status of this frame may come later than its objects; these flags make it blind.
        if (result.header->flags & (MLUC_EMPTY | MLUC_SUSPECT_UNIT | MLUC_SUSPECT_AXES)) state = "blind";
        std::printf("{\"sequence\": %llu, \"state\": \"%s\", \"objects\": [", (unsigned long long)result.header->sequence, state);
        bool is_first = true;
        for (size_t i = 0; i < result.objects_count; ++i) {
            if (result.objects[i].disposition != MLUC_PUBLISHED) continue;
            print(result, is_first, result.objects[i]);
            is_first = false;
        }
        std::printf("]}\n");
        std::fflush(stdout);
    }
    if (code < 0) std::fprintf(stderr, "consumer: %s\n", mluc_last_error());
    mluc_consumer_close(consumer);
    return code < 0 ? 1 : 0;
}
