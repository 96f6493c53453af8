// Reads frames of the server, one a line; prints jawOpen and eyeBlink_L after each, then after the server has gone.
#include <iostream>
#include "FapengineFace.h"

int main()
{
    UMorphTarget jaw{"Face.JawOpen"}, blink{"eyeBlink_L"};
    USkeletalMesh mesh{{&jaw, &blink}};
    USkeletalMeshComponent face{&mesh, {}};
    AActor actor{&face};
    UFapengineFace receiver;
    receiver.owner = &actor;
    receiver.BeginPlay();
    std::string line;
    while (std::getline(std::cin, line)) {
        connected->message.Tell(FString(line));
        receiver.TickComponent(1 / 60.f, LEVELTICK_All, nullptr);
        std::cout << face.weights["Face.JawOpen"] << " " << face.weights["eyeBlink_L"] << " " << receiver.Head.Yaw << "\n";
    }
    connected->closed.Tell(1006, FString(""), false);
    for (int tick = 0; tick < 80; ++tick) receiver.TickComponent(1 / 60.f, LEVELTICK_All, nullptr);
    std::cout << face.weights["Face.JawOpen"] << " " << face.weights["eyeBlink_L"] << " " << connections << "\n";
}
