/* Embree's part in examples/compare: the pairs of a mesh's triangle boxes by rtcCollide, counted.
 *
 * Started as `program RECORDING HALF_CONTACT_DISTANCE THREADS`; what it reads and prints then is described in
 * examples/compare/peers.rs. Embree ends where boxes overlap: it tests nothing exactly. */

#define _POSIX_C_SOURCE 200809L

#include <embree3/rtcore.h>
#include <math.h>
#include <stdatomic.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

static const uint32_t MAGIC = 0x4D534851;

static uint32_t triangle_count;
static uint32_t (*triangles)[3];
static float (*positions)[3];
static float growth;
static struct RTCBounds *boxes;
static atomic_uint_fast64_t pairs;

static void fail(const char *what) {
    fprintf(stderr, "error: %s\n", what);
    exit(2);
}

static void bounds_of(const struct RTCBoundsFunctionArguments *arguments) {
    const uint32_t *corners = triangles[arguments->primID];
    float low[3], high[3];
    for (int axis = 0; axis < 3; axis++) {
        float a = positions[corners[0]][axis], b = positions[corners[1]][axis], c = positions[corners[2]][axis];
        low[axis] = fminf(fminf(a, b), c) - growth;
        high[axis] = fmaxf(fmaxf(a, b), c) + growth;
    }
    struct RTCBounds *bounds = arguments->bounds_o;
    bounds->lower_x = low[0], bounds->lower_y = low[1], bounds->lower_z = low[2];
    bounds->upper_x = high[0], bounds->upper_y = high[1], bounds->upper_z = high[2];
    boxes[arguments->primID] = *bounds;
}

/* Embree gives every pair of a scene with itself in both orders: one of them counts. */
static void count(void *unused, struct RTCCollision *found, unsigned int number) {
    (void)unused;
    uint_fast64_t here = 0;
    for (unsigned int i = 0; i < number; i++)
        here += found[i].primID0 < found[i].primID1;
    atomic_fetch_add_explicit(&pairs, here, memory_order_relaxed);
}

/* It compares the boxes of its leaves, which hold several triangles: theirs are left to be compared. */
static void count_boxes(void *unused, struct RTCCollision *found, unsigned int number) {
    (void)unused;
    uint_fast64_t here = 0;
    for (unsigned int i = 0; i < number; i++) {
        if (found[i].primID0 >= found[i].primID1)
            continue;
        const struct RTCBounds *a = boxes + found[i].primID0, *b = boxes + found[i].primID1;
        here += (a->lower_x <= b->upper_x) & (b->lower_x <= a->upper_x) & (a->lower_y <= b->upper_y) &
                (b->lower_y <= a->upper_y) & (a->lower_z <= b->upper_z) & (b->lower_z <= a->upper_z);
    }
    atomic_fetch_add_explicit(&pairs, here, memory_order_relaxed);
}

static double now(void) {
    struct timespec time;
    clock_gettime(CLOCK_MONOTONIC, &time);
    return 1e9 * (double)time.tv_sec + (double)time.tv_nsec;
}

static void row(const char *what, const char *level, double nanoseconds, long long counted) {
    printf("row\t%s\t%s\t%.0f\t", what, level, nanoseconds);
    printf(counted < 0 ? "-" : "%lld", counted);
    printf("\t-\t-\t-\t-\n");
}

static double collide(RTCScene scene, RTCCollideFunc callback) {
    pairs = 0;
    double start = now();
    rtcCollide(scene, scene, callback, NULL);
    return now() - start;
}

static void fit(RTCGeometry geometry, RTCScene scene, float (*now_at)[3]) {
    positions = now_at;
    rtcCommitGeometry(geometry);
    rtcCommitScene(scene);
}

/* A scene of one user geometry: refitted, or built anew, whenever it is committed. */
static RTCScene make_scene(RTCDevice device, enum RTCBuildQuality quality, RTCGeometry *geometry) {
    RTCScene scene = rtcNewScene(device);
    rtcSetSceneFlags(scene, RTC_SCENE_FLAG_DYNAMIC);
    rtcSetSceneBuildQuality(scene, RTC_BUILD_QUALITY_LOW);
    *geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_USER);
    rtcSetGeometryUserPrimitiveCount(*geometry, triangle_count);
    rtcSetGeometryBoundsFunction(*geometry, bounds_of, NULL);
    rtcSetGeometryBuildQuality(*geometry, quality);
    rtcAttachGeometry(scene, *geometry);
    return scene;
}

int main(int argument_count, char **arguments) {
    if (argument_count != 4)
        fail("expected RECORDING HALF_CONTACT_DISTANCE THREADS");
    FILE *file = fopen(arguments[1], "rb");
    uint32_t header[4];
    if (!file || fread(header, sizeof header, 1, file) != 1 || header[0] != MAGIC)
        fail("expected a recording");
    uint32_t vertex_count = header[1], frame_count = header[3];
    triangle_count = header[2];
    triangles = calloc(triangle_count, sizeof *triangles);
    float(*frames)[3] = calloc((size_t)vertex_count * frame_count, sizeof *frames);
    if (!triangles || !frames || fread(triangles, sizeof *triangles, triangle_count, file) != triangle_count ||
        fread(frames, sizeof *frames, (size_t)vertex_count * frame_count, file) != (size_t)vertex_count * frame_count)
        fail("the recording ends early");
    fclose(file);
    growth = strtof(arguments[2], NULL);
    boxes = calloc(triangle_count, sizeof *boxes);
    if (!boxes)
        fail("there is too little memory");

    char configuration[64];
    snprintf(configuration, sizeof configuration, "threads=%d", atoi(arguments[3]));
    RTCDevice device = rtcNewDevice(configuration);
    if (!device)
        fail("Embree does not start");
    positions = frames + vertex_count;
    RTCGeometry refitted, rebuilt;
    RTCScene scene = make_scene(device, RTC_BUILD_QUALITY_REFIT, &refitted);
    RTCScene new_scene = make_scene(device, RTC_BUILD_QUALITY_LOW, &rebuilt);
    fit(refitted, scene, positions);

    printf("peer Embree\n");
    fflush(stdout);
    char line[64];
    while (fgets(line, sizeof line, stdin)) {
        unsigned long place = strtoul(line, NULL, 10);
        if (2 * place + 1 >= frame_count)
            fail("there is no such tick");
        float(*before)[3] = frames + (size_t)vertex_count * 2 * place;
        float(*at)[3] = before + vertex_count;
        fit(refitted, scene, before);

        double start = now();
        fit(refitted, scene, at);
        row("refit", "part", now() - start, -1);
        double leaves = collide(scene, count);
        row("rtcCollide, counting what its leaves hold", "whole", leaves, -1);
        double exact = collide(scene, count_boxes);
        row("rtcCollide, counting pairs of boxes", "whole", exact, (long long)pairs);
        uint_fast64_t of_refitted = pairs;
        start = now();
        fit(rebuilt, new_scene, at);
        row("rebuild", "part", now() - start, -1);
        double of_new = collide(new_scene, count_boxes);
        row("rtcCollide of the rebuilt tree, counting pairs of boxes", "whole", of_new, (long long)pairs);
        if (pairs != of_refitted)
            fail("a refitted and a new tree give different pairs");
        if (rtcGetDeviceError(device) != RTC_ERROR_NONE)
            fail("Embree reports an error");
        printf("done\n");
        fflush(stdout);
    }
    rtcReleaseGeometry(refitted);
    rtcReleaseGeometry(rebuilt);
    rtcReleaseScene(scene);
    rtcReleaseScene(new_scene);
    rtcReleaseDevice(device);
    return 0;
}
